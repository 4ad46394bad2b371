"""Greedy evaluation: one point of the evaluation curve."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from trainables.curve import EvalPoint
from trainables.numerics.jit import compiled
from trainables.tasks.spec.tabular_model import TransitionModel

__all__ = ["EvalPoint", "expected_return"]


@compiled
def _propagate(
    indptr: NDArray[np.int32],
    indices: NDArray[np.int32],
    probabilities: NDArray[np.float64],
    rewards: NDArray[np.float64],
    policy: NDArray[np.int64],
    start: int,
    time_limit: int,
    gamma: float,
) -> tuple[float, float]:
    states, actions = rewards.shape
    now, after = np.zeros(states), np.zeros(states)
    now[start] = 1.0
    total, discounted, discount = 0.0, 0.0, 1.0
    for _ in range(time_limit):
        reward = 0.0
        for state in range(states):
            mass = now[state]
            if mass == 0.0:
                continue
            now[state] = 0.0
            row = state * actions + policy[state]
            reward += mass * rewards[state, policy[state]]
            for at in range(indptr[row], indptr[row + 1]):
                after[indices[at]] += mass * probabilities[at]
        total += reward
        discounted += discount * reward
        discount *= gamma
        now, after = after, now
    return total, discounted


def expected_return(model: TransitionModel, policy: NDArray[np.int64], gamma: float) -> tuple[float, float]:
    """Return the exact (undiscounted, discounted) return of one episode of `policy` (S,), time limit included."""
    p = model.transitions
    return _propagate(p.indptr, p.indices, p.data, model.rewards, policy, model.start, model.time_limit, gamma)
