"""Greedy evaluation over many environments at once: one forward pass per step for all that still run."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from trainables.numerics.matmul import F32
from trainables.tasks.step_env import Environment


def greedy_returns(
    environments: Sequence[Environment], seeds: Sequence[int], policy: Callable[[F32], F32], gamma: float
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """(undiscounted, discounted) returns (n,) of one episode in each environment.

    policy: observations (n, inputs) to preferences (n, actions); the first of the largest is taken.
    """
    observations = np.stack([env.reset(seed) for env, seed in zip(environments, seeds, strict=True)])
    total, discounted = np.zeros(len(environments)), np.zeros(len(environments))
    running, discount = list(range(len(environments))), 1.0
    while running:
        actions = policy(observations[running]).argmax(axis=1).tolist()
        still = []
        for i, action in zip(running, actions, strict=True):
            observations[i], reward, terminated, truncated = environments[i].step(action)
            total[i] += reward
            discounted[i] += discount * reward
            if not (terminated or truncated):
                still.append(i)
        running, discount = still, discount * gamma
    return total, discounted
