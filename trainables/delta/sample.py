"""Samples of delta, on which every tabular or deep estimator is based."""

from __future__ import annotations

from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from trainables.numerics.jit import compiled
from trainables.tasks.rollout import F32, Transitions, Values

Number = TypeVar("Number", float, NDArray[np.float32], NDArray[np.float64])


@compiled
def delta_sample(reward: Number, gamma: float | np.float32, v_next: Number, q_src: Number) -> Number:
    """Return r + gamma V_src(s') - Q_src(s,a), whose expectation is delta(s,a): eqs. (2) and (4).

    v_next: V_src(s') = max_b Q_src(s',b), and 0 where s' is terminal.
    """
    return reward + gamma * v_next - q_src  # type: ignore[return-value]


def v_and_q(source: Values, seen: Transitions) -> tuple[F32, F32]:
    """Return V_src(s'), 0 where s' is terminal, and Q_src(s,a) of each transition, (n,)."""
    v_next = np.where(seen.terminated, np.float32(0), source.rows(seen.next_observations).max(axis=1))
    return v_next, chosen(source.rows(seen.observations), seen.actions)


def chosen(values: F32, actions: NDArray[np.int64]) -> F32:
    """Return the value (n,) of each row's action in values (n, actions)."""
    result: F32 = np.take_along_axis(values, actions[:, None], axis=1)[:, 0]
    return result


def delta_samples(source: Values, seen: Transitions, gamma: float) -> F32:
    """Return a sample of delta for each transition, (n,)."""
    return delta_sample(seen.rewards, np.float32(gamma), *v_and_q(source, seen))
