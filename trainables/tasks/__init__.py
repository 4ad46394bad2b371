"""The tasks that have a name. Add one: write its file, and add its family to `_families`."""

from __future__ import annotations

import functools

from trainables.errors import InputError, unknown
from trainables.tasks.task import ContextFeature, Task, TaskFamily, Value, split_features

__all__ = ["ContextFeature", "Task", "TaskFamily", "Value", "families", "parse_task"]


@functools.cache
def families() -> dict[str, TaskFamily]:
    """The registered task families by name."""
    from trainables.tasks import supply_chain, windy_gridworld

    return {family.name: family for family in (windy_gridworld.FAMILY, supply_chain.FAMILY)}


@functools.lru_cache(maxsize=1024)
def parse_task(text: str) -> Task:
    """The task called NAME[:FEATURE=VALUE,...].

    Raises InputError for an unknown name or feature (with the list of what there is), a value out of its
    range, and a feature that is given twice.
    """
    name, _, features = text.strip().partition(":")
    if name not in families():
        raise unknown("task", name, families())
    family = families()[name]
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
