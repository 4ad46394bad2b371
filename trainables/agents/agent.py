"""An agent: its name, its hyperparameters, and the learner that trains it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Literal

from pydantic import ValidationError

from trainables.agents.base import Hyperparameters
from trainables.agents.plots import Plot
from trainables.errors import InputError, from_validation, unknown
from trainables.tasks.registry import families
from trainables.tasks.spec.family import Task


@dataclass(frozen=True)
class Agent:
    """An agent as it is registered under a name."""

    name: str
    description: str
    hyperparameters: type[Hyperparameters]
    base: str | None
    """The agent without transfer that it is compared with, and that trains its source; None: it has no transfer."""
    learner: str | Callable[..., Any]
    """The learner's class, or its `module:Class`, which is imported when a cell is trained."""
    kind: Literal["tabular", "deep"] = "tabular"
    origin: Literal["built-in", "custom", "missing"] = "built-in"
    """missing: a custom agent whose code is not loaded."""
    rivals: tuple[str, ...] = ()
    """Agents that it builds on or is an answer to: what is shown first is its difference from them."""
    several: bool = False
    """Whether it chooses among several sources, so that its cells may name a library."""
    shown: tuple[str, ...] = ()
    """Hyperparameters that are part of its name in tables and figures, even at their defaults."""
    usual: bool = False
    """Whether it is among the agents that are compared by default."""
    algorithm: int | None = None
    """Its number among the paper's algorithms, if it is one."""
    look: str = ""
    """A key of `dashboards.style.PALETTE`; empty: one that no other agent of its kind has."""
    plots: tuple[Plot, ...] = ()
    """The statistics that the report draws over training."""
    no_task_default: tuple[str, ...] = ("threshold",)
    """Hyperparameters that take no default from the task (`TaskFamily.defaults`): the paper's thresholds are on the
    scale of Algorithm 1."""

    continues: bool = True
    """Whether its training knows nothing of how many episodes are to come, unless its hyperparameters say otherwise
    (`Hyperparameters.fixed_length`): a cell of more episodes then continues a shorter one."""

    def anew(self, settings: Hyperparameters) -> str:
        """Return why a cell of more episodes cannot continue a shorter one, as a clause; empty where it can."""
        return settings.fixed_length if self.continues else "the custom agent does not declare continues=True"

    @property
    def extra(self) -> str:
        """The extra of the package that its learner needs; empty: none."""
        return "deep" if self.kind == "deep" and self.origin == "built-in" else ""

    @property
    def needs_source(self) -> bool:
        """Whether cells of this agent need a source."""
        return self.base is not None

    def resolve(self, task: Task, given: dict[str, object]) -> Hyperparameters:
        """Return all hyperparameters for `task`: the given ones, then the task's (Tables 4 to 7), then the defaults.

        Raises InputError for a wrong key, type or range, or where the agent cannot learn this task.
        """
        if "missing" in (self.origin, task.family.origin):
            pass
        elif self.kind == "tabular" and not task.tabular:
            tabular = [name for name, family in families().items() if family.model is not None]
            raise InputError(f"{self.name} needs a tabular task ({', '.join(tabular)}), which {task.name} is not")
        elif self.kind == "deep" and task.tabular:
            deep = [name for name, family in families().items() if family.model is None]
            raise InputError(f"{self.name} needs a task with vector observations ({', '.join(deep)}), not {task.name}")
        known = self.hyperparameters.model_fields
        usable = known.keys() - set(self.no_task_default)
        defaults = {key: value for key, value in task.family.defaults.items() if key in usable}
        for key in given:
            if key not in known and self.origin != "missing":
                raise unknown(f"hyperparameter of {self.name}", key, known)
        try:
            return self.hyperparameters.model_validate(defaults | given)
        except ValidationError as error:
            raise from_validation(self.name, error) from None
