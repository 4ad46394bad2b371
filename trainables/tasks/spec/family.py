"""Tasks: environments with context features, and their names.

NAME[:FEATURE=VALUE,...], e.g. `windy_gridworld`, `windy_gridworld:wind=reversed`, `supply_chain:demand_mean=5`.
"""

from __future__ import annotations

import difflib
import math
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Literal

from trainables.errors import InputError, unknown

if TYPE_CHECKING:
    import gymnasium

    from trainables.tasks.spec.tabular_model import Dynamics, TransitionModel

Value = float | tuple[int, ...]
Context = Mapping[str, Any]
"""Feature name to value, for all features of a task."""


@dataclass(frozen=True)
class ContextFeature:
    """A parameter of a task's dynamics that can be changed (CARL's term)."""

    name: str
    default: Value
    description: str
    parse: Callable[[str], Value]
    """Converts text to a value. Raises InputError, which says what is allowed."""
    named: Mapping[str, Value] = field(default_factory=dict)
    """Named values, e.g. the wind vectors of the paper's Table 2."""

    def value(self, text: str) -> Value:
        """Return the value of `text`: a name, a multiple of the default ('5x'), or a plain value."""
        if text in self.named:
            return self.named[text]
        plain = text
        if isinstance(self.default, float) and re.fullmatch(r"[-+0-9.eE]+x", text):
            plain = f"{self.default * self._number(text[:-1]):.12g}"
        try:
            return self.parse(plain)
        except InputError as error:
            names = f", or one of {', '.join(self.named)}" if self.named else ""
            near = difflib.get_close_matches(text, self.named, n=1)
            names += f"; did you mean '{near[0]}'?" if near else ""
            raise InputError(f"{self.name} must be {error}{names} (got '{text}')") from None

    def text(self, value: Value) -> str:
        """Return the canonical spelling of `value`; `value(text(v)) == v`."""
        for name, known in self.named.items():
            if known == value:
                return name
        if isinstance(value, tuple):
            return "[" + ",".join(map(str, value)) + "]"
        return repr(value).removesuffix(".0")

    def _number(self, text: str) -> float:
        try:
            return float(text)
        except ValueError:
            raise InputError(f"{self.name} must be a number, or a multiple such as 2x (got '{text}x')") from None


@dataclass(frozen=True)
class TaskFamily:
    """A registered task: its features, and how to build an environment from their values."""

    name: str
    description: str
    features: tuple[ContextFeature, ...]
    defaults: Mapping[str, float | int | str]
    """The paper's hyperparameters for this task, by name (Tables 4 to 7)."""
    targets: tuple[str, ...] = ()
    """The target tasks of the paper, as full names."""
    build: Callable[[Context], gymnasium.Env] | None = None
    """Makes the environment, time limit included; None for tabular tasks, whose dynamics suffice."""
    dynamics: Callable[[Context], Dynamics] | None = None
    """Tabular tasks only: returns the step function and its parameters."""
    model: Callable[[Context], TransitionModel] | None = None
    """Tabular tasks only: returns the exact transition model."""
    check: Callable[[Context], None] = lambda context: None
    """Raises InputError for values that are allowed alone but not together."""
    plain: Callable[[], gymnasium.Env] | None = None
    """Makes the environment without deltatune, which the task at its defaults must equal bit for bit."""
    extra: str = ""
    """The extra of the package that its simulator needs; empty: none."""
    solved_at: float | None = None
    """The return at which the task counts as solved (Gymnasium's reward_threshold); None where there is none."""
    origin: Literal["built-in", "custom", "missing"] = "built-in"
    """missing: a custom task whose code is not loaded."""

    def feature(self, name: str) -> ContextFeature:
        """Return the feature called `name`. Raises InputError where there is none."""
        for feature in self.features:
            if feature.name == name:
                return feature
        raise unknown(f"context feature of {self.name}", name, [feature.name for feature in self.features])


@dataclass(frozen=True)
class Task:
    """A task: a family and the values of the features that are not at their defaults."""

    family: TaskFamily
    changed: tuple[tuple[str, Value], ...] = ()

    @property
    def name(self) -> str:
        """The canonical name: features in the family's order, without those at their defaults."""
        parts = [f"{name}={self.family.feature(name).text(value)}" for name, value in self.changed]
        return self.family.name + (":" + ",".join(parts) if parts else "")

    @property
    def context(self) -> dict[str, Value]:
        """The values of all features."""
        return {feature.name: feature.default for feature in self.family.features} | dict(self.changed)

    @property
    def tabular(self) -> bool:
        """Whether the task has finitely many states and an exact model."""
        return self.family.model is not None

    def dynamics(self) -> Dynamics:
        """Return the step function and its parameters. Raises InputError for a task that is not tabular."""
        if self.family.dynamics is None:
            raise InputError(f"{self.name} is not a tabular task")
        return self.family.dynamics(self.context)

    def model(self) -> TransitionModel:
        """Return the exact transition model. Raises InputError for a task that is not tabular."""
        if self.family.model is None:
            raise InputError(f"{self.name} has no transition model: it is not a tabular task")
        return self.family.model(self.context)


def split_features(text: str) -> list[str]:
    """Split 'a=1,b=[1,2]' at the commas outside brackets."""
    return [part for part in re.split(r",(?![^\[]*\])", text) if part]


def number(low: float, high: float) -> Callable[[str], float]:
    """Return a parser of finite numbers in [low, high]."""

    def parse(text: str) -> float:
        try:
            value = float(text)
        except ValueError:
            value = math.nan
        if not low <= value <= high:
            raise InputError(f"a number between {low:g} and {high:g}")
        return value

    return parse


def integers(length: int, low: int, high: int) -> Callable[[str], tuple[int, ...]]:
    """Return a parser of '[i,j,...]': `length` whole numbers in [low, high]."""

    def parse(text: str) -> tuple[int, ...]:
        inner = re.fullmatch(r"\[(.*)\]", text.replace(" ", ""))
        items = inner.group(1).split(",") if inner else []
        if len(items) != length or not all(re.fullmatch(r"[-+]?\d+", item) for item in items):
            raise InputError(f"{length} whole numbers in brackets, such as [{','.join(['0'] * min(length, 3))}…]")
        values = tuple(int(item) for item in items)
        if not all(low <= value <= high for value in values):
            raise InputError(f"whole numbers between {low} and {high}")
        return values

    return parse
