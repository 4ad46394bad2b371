"""Exact values and exact delta of tabular tasks.

Only sparse products and element-wise arithmetic, no BLAS: the same bits on every machine.
"""

from __future__ import annotations

import functools

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array

from trainables.tasks.registry import model_of
from trainables.tasks.spec.tabular_model import TransitionModel

Array = NDArray[np.float64]

TOLERANCE = 1e-14
"""Largest Bellman residual at the end, relative to the largest value."""


def _evaluate(model: TransitionModel, policy: NDArray[np.int64], gamma: float, values: Array, sweeps: int) -> Array:
    """Return `values` (S,) after up to `sweeps` backups under a fixed policy, fewer where they stop changing."""
    actions = model.rewards.shape[1]
    states = np.arange(len(values))
    transitions: csr_array = gamma * model.transitions[states * actions + policy]
    rewards = model.rewards[states, policy]
    for _ in range(sweeps):
        new = rewards + transitions @ values
        change = float(np.max(np.abs(new - values)))
        values = new
        if change <= TOLERANCE * max(1.0, float(np.max(np.abs(values)))):
            break
    return values


def backup(model: TransitionModel, values: Array, gamma: float) -> Array:
    """Return r(s,a) + gamma E[values(s')], (S, A), for `values` (S,)."""
    return model.rewards + gamma * model.expected_next(values)


def value_iteration(model: TransitionModel, gamma: float) -> Array:
    """Return Q* (S, A), by value iteration with many cheap backups of the greedy policy in each step."""
    values = np.zeros(model.rewards.shape[0])
    while True:
        q = backup(model, values, gamma)
        policy = q.argmax(axis=1)
        residual = float(np.max(np.abs(q.max(axis=1) - values)))
        if residual <= TOLERANCE * max(1.0, float(np.max(np.abs(values)))):
            return q
        values = _evaluate(model, policy, gamma, q.max(axis=1), sweeps=500)


def policy_q(model: TransitionModel, policy: NDArray[np.int64], gamma: float) -> Array:
    """Return Q^pi (S, A) of the deterministic `policy` (S,)."""
    values = _evaluate(model, policy, gamma, np.zeros(model.rewards.shape[0]), sweeps=1_000_000)
    return backup(model, values, gamma)


def exact_delta(target: TransitionModel, q_src: Array, gamma: float, policy: NDArray[np.int64] | None = None) -> Array:
    """Return E_trg[r + gamma V_src(s')] - Q_src(s,a), (S, A), for `q_src` (S, A); 0 at terminal states.

    This is the fixed point of eq. (2), with V_src(s') = max_b Q_src(s',b), or Q_src(s',policy(s')) under a `policy`
    (S,), and 0 at a terminal s'. The paper's definition compares only transition probabilities; where the expected
    reward depends on the dynamics too (supply chain) the two differ, and only this form satisfies
    Q_trg - Q_src = delta + gamma E_trg[V_trg - V_src]; Theorems 1 and 3 follow.
    """
    v_src = q_src.max(axis=1) if policy is None else q_src[np.arange(len(q_src)), policy]
    v_src = np.where(target.terminal, 0.0, v_src)
    return np.where(target.terminal[:, None], 0.0, backup(target, v_src, gamma) - q_src)


@functools.lru_cache(maxsize=8)
def exact_q(task: str, gamma: float) -> Array:
    """Return Q* (S, A) of the task called `task`, read-only."""
    q = value_iteration(model_of(task), gamma)
    q.setflags(write=False)
    return q
