"""The shape of what is learned on a task. Light to import, and to call for a tabular task."""

from __future__ import annotations

from contextlib import closing

from trainables.tasks.spec.family import Task

Shape = tuple[int, int]
"""(states, actions) of a tabular task, (inputs, actions) of a deep one."""


def task_shape(task: Task) -> Shape:
    """Return the shape that knowledge of `task` must fit."""
    if task.tabular:
        dynamics = task.dynamics()
        return dynamics.states, dynamics.actions

    from trainables.tasks.make import make_env
    from trainables.tasks.step_env import Environment  # compiles

    with closing(Environment(make_env(task))) as env:
        return env.inputs, env.actions
