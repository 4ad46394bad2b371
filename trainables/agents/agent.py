"""An agent: what it is called, its hyperparameters, and which learner trains it."""

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
    """What is registered under a name."""

    name: str
    description: str
    hyperparameters: type[Hyperparameters]
    base: str | None
    """The agent without transfer that this one is compared with and whose source it uses; None: it is one itself."""
    learner: str | Callable[..., Any]
    """The learner's class, or the `module:Class` of one that is imported when a cell is trained."""
    kind: Literal["tabular", "deep"] = "tabular"
    origin: Literal["built-in", "custom", "missing"] = "built-in"
    """Whose it is: deltatune's, the user's, or a user's whose code is not loaded."""
    several: bool = False
    """Whether it chooses among several sources: a cell of it may name a library beside the source."""
    shown: tuple[str, ...] = ()
    """Hyperparameters that are named beside it wherever it is, at their defaults too."""
    usual: bool = False
    """Whether it is among the agents that are compared where nobody says which."""
    algorithm: int | None = None
    """The number of the paper's algorithm that it is."""
    look: str = ""
    """A colour of `dashboards.style.PALETTE`, with its dash and marker; empty: one that no agent of its kind has."""
    plots: tuple[Plot, ...] = ()
    """What the report draws of it over training."""
    no_task_default: tuple[str, ...] = ("threshold",)
    """Hyperparameters that take no default from the task (`TaskFamily.defaults`): the paper's thresholds are on the
    scale of Algorithm 1."""

    @property
    def needs_source(self) -> bool:
        """Whether a cell of this agent names a source."""
        return self.base is not None

    def resolve(self, task: Task, given: dict[str, object]) -> Hyperparameters:
        """All hyperparameters for `task`: the given ones, then the task's own (Tables 4 to 7), then the defaults.

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
