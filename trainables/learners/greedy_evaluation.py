"""Greedy evaluation in many environments at once, with one forward pass per step for all running ones."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from trainables.numerics.matmul import F32
from trainables.tasks.simulators.simulator import step_all
from trainables.tasks.step_env import Environment


def greedy_returns(
    environments: Sequence[Environment], seeds: Sequence[int], policy: Callable[[F32], F32], gamma: float
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the (undiscounted, discounted) returns (n,) of one episode in each environment.

    policy: observations (n, inputs) to preferences (n, actions); ties go to the lowest action.
    """
    observations = np.stack([env.reset(seed) for env, seed in zip(environments, seeds, strict=True)])
    total, discounted = np.zeros(len(environments)), np.zeros(len(environments))
    if all(env.simulator is not None and env.simulator is environments[0].simulator for env in environments):
        _simulate(environments, observations, policy, gamma, total, discounted)
        return total, discounted
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


def _simulate(
    environments: Sequence[Environment],
    observations: F32,
    policy: Callable[[F32], F32],
    gamma: float,
    total: NDArray[np.float64],
    discounted: NDArray[np.float64],
) -> None:
    """Compute `greedy_returns` for episodes of a compiled simulator, from their first observations on."""
    simulator = environments[0].simulator
    assert simulator is not None
    states = np.stack([env.state for env in environments])
    running, left, discount = np.arange(len(environments)), len(environments), 1.0
    for _ in range(environments[0].time_limit):
        actions = policy(observations[running[:left]]).argmax(axis=1)
        left = step_all(*simulator.physics, actions, running, states, observations, total, discounted, discount)
        if not left:
            break
        discount *= gamma
