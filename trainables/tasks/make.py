"""Builds the environment of a task."""

from __future__ import annotations

from typing import TYPE_CHECKING

from trainables.extras import require
from trainables.tasks.spec.family import Task

if TYPE_CHECKING:
    import gymnasium


def make_env(task: Task) -> gymnasium.Env:
    """Return a new environment of `task`, time limit included. Raises InputError where its simulator is missing."""
    require({task.name: task.family.extra})
    if task.family.build is not None:
        env = task.family.build(task.context)
        if task.family.origin == "built-in":
            return env
        from trainables.tasks.wrappers.guard import guarded

        return guarded(env, task.name)
    from trainables.tasks.tabular_env import make

    return make(task.dynamics())
