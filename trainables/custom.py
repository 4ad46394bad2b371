"""What a custom file or package imports to bring a task or an agent: docs/custom_task.md and docs/custom_agent.md."""

from __future__ import annotations

import inspect
from collections.abc import Callable
from typing import TYPE_CHECKING, Any, Literal

from trainables.agents.agent import Agent
from trainables.agents.base import Hyperparameters
from trainables.agents.plots import Plot
from trainables.errors import InputError
from trainables.plugins.loader import pin
from trainables.tasks.spec.family import Context, ContextFeature, TaskFamily, number
from trainables.tasks.wrappers.discretise import discretise, levels_feature

if TYPE_CHECKING:
    import gymnasium

    from trainables.tasks.spec.tabular_model import TransitionModel

__all__ = ["agent", "feature", "load", "tabular_task", "task"]

Scalar = float | int | str


def load(name: str) -> str:
    """Run the file of FILE.py:NAME[:FEATURE=VALUE,...], and return the canonical name of the task or agent."""
    return pin(name)


def feature(name: str, default: float, low: float, high: float, description: str = "") -> ContextFeature:
    """Return a context feature: a number in [low, high] with which the environment is built."""
    if not low <= default <= high:
        raise InputError(f"feature {name}: the default must be between {low:g} and {high:g} (got {default:g})")
    return ContextFeature(name, float(default), description, number(low, high))


def task(
    build: Callable[..., gymnasium.Env],
    *features: ContextFeature,
    limit: int | None = None,
    levels: int | None = None,
    plain: Callable[[], gymnasium.Env] | None = None,
    targets: tuple[str, ...] = (),
    solved_at: float | None = None,
    **defaults: Scalar,
) -> TaskFamily:
    """Return a task with vector observations.

    build: a class or function that makes the environment from the values of all features, passed by keyword.
    limit: steps until an episode is truncated; it becomes a feature. None: `build` sets a TimeLimit itself.
    levels: values of each dimension of continuous actions; it becomes a feature. None: the actions are Discrete.
    plain: makes the environment without features; None: `build` without arguments.
    targets: feature texts of the usual target tasks, e.g. ("gravity=2x",). defaults: hyperparameters for this task.
    solved_at: the return at which it counts as solved, for the episodes that an agent needs to solve it.
    Raises InputError for features that `build` does not take, and for a name given twice.
    """
    extra = [] if levels is None else [levels_feature(float(levels))]
    extra += [] if limit is None else [_limit_feature(limit)]
    _check(build, features, {added.name for added in extra})

    def finished(env: gymnasium.Env, context: Context) -> gymnasium.Env:
        from gymnasium.wrappers import TimeLimit

        if limit is not None:
            env = TimeLimit(env, int(context.get("limit", limit)))
        return env if levels is None else discretise(env, context.get("levels", levels))

    def make(context: Context) -> gymnasium.Env:
        return finished(build(**{f.name: context[f.name] for f in features}), context)

    return TaskFamily(
        "custom",
        _first_line(build),
        (*features, *extra),
        defaults,
        targets,
        build=make,
        plain=lambda: finished((plain or build)(), {}),
        solved_at=solved_at,
    )


def tabular_task(
    model: Callable[..., TransitionModel],
    *features: ContextFeature,
    targets: tuple[str, ...] = (),
    solved_at: float | None = None,
    **defaults: Scalar,
) -> TaskFamily:
    """Return a task with finitely many states, defined by its exact model, from which training samples its steps.

    model: makes the transition model from the values of all features, passed by keyword. For the rest see `task`.
    """
    from trainables.tasks.builtin import from_model

    _check(model, features, set())

    def exact(context: Context) -> TransitionModel:
        return from_model.checked(model(**context))

    return TaskFamily(
        "custom",
        _first_line(model),
        features,
        defaults,
        targets,
        dynamics=lambda context: from_model.dynamics(exact(context)),
        model=exact,
        solved_at=solved_at,
    )


def agent(
    learner: type,
    hyperparameters: type[Hyperparameters],
    *,
    base: str | None = None,
    kind: Literal["tabular", "deep"] = "tabular",
    shown: tuple[str, ...] = (),
    plots: tuple[Plot, ...] = (),
    continues: bool = False,
) -> Agent:
    """Return an agent.

    learner: a class that is built from (cell, source) and has run, evaluate and knowledge (`learners.learner.Learner`).
    hyperparameters: their ranges and defaults, a subclass of those in `trainables.agents.hyperparameters`.
    base: the agent without transfer that it is compared with, and that trains its source; None: it has no transfer.
    shown: hyperparameters that are part of its name in tables and figures, even at their defaults.
    plots: the statistics that the report draws over training (`trainables.agents.plots`).
    continues: whether the learner has `state` and `restore`, and trains alike whatever `episodes` is, so that a cell of
    more episodes may continue a shorter one.
    Raises InputError for a learner that lacks one of these methods.
    """
    lacking = [name for name in ("run", "evaluate", "knowledge") if not callable(getattr(learner, name, None))]
    if lacking:
        raise InputError(f"the learner {learner.__name__} has no method {lacking[0]}")
    if not (isinstance(hyperparameters, type) and issubclass(hyperparameters, Hyperparameters)):  # type: ignore[redundant-expr]
        raise InputError(f"hyperparameters must be a class derived from Hyperparameters (got {hyperparameters!r})")
    hyperparameters.model_rebuild()  # raises here, not at first use, where its types are not pydantic's
    return Agent(
        "custom",
        _first_line(learner),
        hyperparameters,
        base,
        learner,
        kind,
        shown=tuple(shown),
        plots=tuple(plots),
        continues=continues,
    )


def _limit_feature(limit: int) -> ContextFeature:
    return ContextFeature("limit", float(limit), "steps until an episode is truncated", number(1, 10_000_000))


def _check(build: Callable[..., Any], features: tuple[ContextFeature, ...], reserved: set[str]) -> None:
    names = [feature.name for feature in features]
    for name in names:
        if names.count(name) > 1 or name in reserved:
            raise InputError(f"the name '{name}' of a feature is already taken")
    try:
        inspect.signature(build).bind(**dict.fromkeys(names))
    except TypeError as error:
        raise InputError(
            f"{build.__name__} cannot be called with the features {', '.join(names) or '(none)'}: {error}"
        ) from None


def _first_line(thing: Any) -> str:
    return (inspect.getdoc(thing) or "").split("\n")[0]
