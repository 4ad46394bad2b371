"""The registry of tasks. To add one, write its module and add it to `families` (docs/extending.md)."""

from __future__ import annotations

import functools
from typing import TYPE_CHECKING

from trainables.errors import InputError, unknown
from trainables.plugins import entry_points, names
from trainables.tasks import custom, gymnasium_task
from trainables.tasks.spec.family import ContextFeature, Task, TaskFamily, Value, split_features

if TYPE_CHECKING:
    from trainables.tasks.spec.tabular_model import TransitionModel

__all__ = ["ContextFeature", "Task", "TaskFamily", "Value", "all_families", "families", "parse_task"]


@functools.cache
def families() -> dict[str, TaskFamily]:
    """Return the registered task families by name."""
    from trainables.tasks.builtin import acrobot, cartpole, lunar_lander, reacher, supply_chain, windy_gridworld

    modules = (
        windy_gridworld,
        supply_chain,
        cartpole,
        acrobot,
        lunar_lander,
        reacher,
    )
    found = {module.FAMILY.name: module.FAMILY for module in modules}
    entry_points.check_names("task", found)
    return found


def all_families() -> list[TaskFamily]:
    """Return the registered task families, those of installed packages included."""
    brought = [custom.installed_family(name) for name in entry_points.names("task")]
    return [*families().values(), *(family for family in brought if family is not None)]


def parse_task(text: str) -> Task:
    """Return the task NAME[:FEATURE=VALUE,...], gym:ENV_ID[:attribute.path=VALUE,...] or FILE.py@PIN:NAME[:...].

    Raises InputError for an unknown name or feature (with the list of known ones), a value out of its range, and a
    feature that is given twice. A task whose file or package is missing is a placeholder that cannot be built.
    """
    text = text.strip()
    return _task(text, *custom.family(text)) if names.is_custom(text) else _known(text)


@functools.lru_cache(maxsize=1024)
def _known(text: str) -> Task:
    return _task(text, *_family(text))


def _task(text: str, family: TaskFamily, features: str) -> Task:
    values: dict[str, Value] = {}
    for part in split_features(features):
        key, equals, value = part.partition("=")
        feature = family.feature(key.strip())
        if not equals or not value:
            raise InputError(f"task '{text}': write {key.strip()}=VALUE (got '{part}')")
        if feature.name in values:
            raise InputError(f"task '{text}': {feature.name} is given twice")
        values[feature.name] = feature.value(value.strip())
    changed = tuple((f.name, values[f.name]) for f in family.features if values.get(f.name, f.default) != f.default)
    task = Task(family, changed)
    family.check(task.context)
    return task


def _family(text: str) -> tuple[TaskFamily, str]:
    """Return the family that `text` names, and the text of its features."""
    if text.startswith(f"{gymnasium_task.PREFIX}:"):
        name, features = gymnasium_task.split(text)
        paths = tuple(part.partition("=")[0].strip() for part in split_features(features))
        return gymnasium_task.family(name, paths), features
    name, _, features = text.partition(":")
    if name in families():
        return families()[name], features
    found = custom.installed_family(name)
    if found is None:
        raise unknown("task", name, [*families(), *entry_points.names("task")])
    return found, features


@functools.lru_cache(maxsize=4)
def model_of(task: str) -> TransitionModel:
    """Return the transition model of the task called `task`; the last one is cached."""
    return parse_task(task).model()
