"""Greedy policies of a learner, and of source knowledge on a task."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from trainables.agents.hyperparameters import DQN
from trainables.cell import Cell
from trainables.errors import InputError
from trainables.knowledge import Knowledge
from trainables.learners.learner import Learner
from trainables.tasks.shape import task_shape
from trainables.tasks.spec.family import Task

Policy = Callable[[Any], int]
"""Maps a state (tabular tasks) or an observation (inputs,) float32 to an action, numbered from 0."""


def learned_policy(learner: Learner) -> Policy:
    """Return the policy that greedy evaluation of a learner follows, such as its source's while its gate is open.

    Raises InputError for a custom learner with neither `policy()` (S,) nor `preferences(observations)`.
    """
    policy, preferences = getattr(learner, "policy", None), getattr(learner, "preferences", None)
    if callable(policy):
        return _tabular(np.asarray(policy(), np.int64))
    if callable(preferences):
        return lambda observation: int(preferences(observation[None]).argmax())
    raise InputError(f"{type(learner).__name__} has no method `policy` or `preferences`: it cannot be played")


def source_policy(knowledge: Knowledge, trained_by: Cell, task: Task, checkpoint: str = "best") -> Policy:
    """Return argmax_a Q_src(s, a) on `task`, the lowest action on ties.

    checkpoint: which of a deep source's networks, 'best' or 'last'. Raises InputError where the source does not fit.
    """
    settings = trained_by.settings
    if task.tabular and "q" in knowledge.arrays:
        return _tabular(knowledge.q_table(task_shape(task)).argmax(axis=1))
    if not isinstance(settings, DQN) or task.tabular:
        raise InputError(f"what was learned on {trained_by.task} does not fit {task.name}")
    from trainables.networks.network import source_network

    network = source_network(knowledge, checkpoint, settings, *task_shape(task))
    return lambda observation: int(network.row(observation).argmax())


def _tabular(policy: np.ndarray[Any, Any]) -> Policy:
    return lambda state: int(policy[state])
