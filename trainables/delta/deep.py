"""delta of a source network: samples on transitions, and its noise floor, the same on the source's own task."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from trainables.streams import stream
from trainables.tasks import parse_task

F32 = NDArray[np.float32]

FLOOR_EPISODES = 10
"""Episodes on the source's own task, unless said."""


class Values(Protocol):
    """What is asked of a source network here."""

    def rows(self, observations: F32) -> F32:
        """Q(s, .) (n, actions) at observations (n, inputs)."""


class Transitions(NamedTuple):
    """n transitions."""

    observations: F32
    """(n, inputs)."""
    actions: NDArray[np.int64]
    """(n,)."""
    rewards: F32
    """(n,)."""
    next_observations: F32
    """(n, inputs)."""
    terminated: NDArray[np.bool_]
    """(n,)."""


@dataclass(frozen=True)
class Episode:
    """What one episode says of the source that was followed in it."""

    path_delta: float
    """sum_t gamma^t delta(s_t, a_t): the discounted return less what the source promised, V_src(s_0)."""
    promise: float
    """V_src(s_0)."""
    mean_abs: float
    """Mean |delta| over its steps."""
    mean_square: float
    """Mean delta^2 over its steps."""
    steps: int


@dataclass(frozen=True)
class SelfDelta:
    """delta of a source on its own task, where only its errors are left of it."""

    mean_abs: float
    """Mean over all steps of |delta|."""
    root_mean_square: float
    """Root of the mean over all steps of delta^2."""
    episodes: tuple[Episode, ...]


def delta_samples(source: Values, seen: Transitions, gamma: float) -> F32:
    """Samples r + gamma max_b Q_src(s',b) - Q_src(s,a), (n,); 0 for max_b where terminated: eq. (4)'s targets."""
    future = np.where(seen.terminated, np.float32(0), np.float32(gamma) * source.rows(seen.next_observations).max(1))
    q = np.take_along_axis(source.rows(seen.observations), seen.actions[:, None], axis=1)[:, 0]
    result: F32 = seen.rewards + future - q
    return result


def episode_of(source: Values, seen: Transitions, gamma: float) -> Episode:
    """What the transitions of one episode, in order, say of the source that was followed in it."""
    samples = delta_samples(source, seen, gamma).astype(np.float64)
    discounts = gamma ** np.arange(len(samples))
    promise = float(source.rows(seen.observations[:1]).max())
    mean_abs, mean_square = float(np.abs(samples).mean()), float((samples**2).mean())
    return Episode(float(discounts @ samples), promise, mean_abs, mean_square, len(samples))


def self_delta(source: Values, task: str, gamma: float, seed: int, episodes: int = FLOOR_EPISODES) -> SelfDelta:
    """The noise floor of a source trained on `task`: its greedy policy followed there, by a stream of its own."""
    from trainables.delta.rollout import Rollout

    rollout = Rollout(parse_task(task), stream(seed, "calibration", task))
    found = tuple(episode_of(source, rollout.episode(source), gamma) for _ in range(episodes))
    steps = sum(episode.steps for episode in found)
    mean_abs = math.fsum(episode.mean_abs * episode.steps for episode in found) / steps
    square = math.fsum(episode.mean_square * episode.steps for episode in found) / steps
    return SelfDelta(mean_abs, math.sqrt(square), found)
