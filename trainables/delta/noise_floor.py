"""The noise floor of a source: the size of a gate's estimate of delta on the source's own task, where delta is 0.

A learned source has errors, and a gate with a small learning rate still sees the noise of single samples. Both make
|delta| large even where the tasks are equal. `threshold: auto` is the largest value that the gate would have seen in
RUNS runs of as many episodes on the source task, following the source: the smallest threshold at which it would have
stayed open in all of them.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from trainables.delta import tabular_estimator
from trainables.delta.sample import delta_sample, delta_samples
from trainables.delta.tabular_estimator import DeltaRule, DeltaTable
from trainables.numerics.jit import compiled
from trainables.numerics.rng import stream
from trainables.tasks.registry import parse_task
from trainables.tasks.rollout import Transitions, Values
from trainables.tasks.tabular_env import step as env_step

RUNS = 10
"""Runs over which the largest delta is taken; after a single run, every second new one would exceed it."""


class SourceTables(NamedTuple):
    """Q_src (S, A), max_b Q_src(s,b) (S,) and argmax_b Q_src(s,b) (S,)."""

    q: NDArray[np.float64]
    v: NDArray[np.float64]
    pi: NDArray[np.int64]


@compiled
def _largest(
    kind: int,
    parameters: NDArray[np.float64],
    start: int,
    time_limit: int,
    source: SourceTables,
    table: DeltaTable,
    rule: DeltaRule,
    gamma: float,
    episodes: int,
    rng: np.random.Generator,
) -> float:
    largest = 0.0
    for _ in range(episodes):
        state = start
        for _ in range(time_limit):
            action = source.pi[state]
            next_state, reward, terminated = env_step(kind, state, action, parameters, rng)
            v_next = 0.0 if terminated else source.v[next_state]
            sample = delta_sample(reward, gamma, v_next, source.q[state, action])
            tabular_estimator.update(table, rule, state, action, sample)
            largest = max(largest, tabular_estimator.size(table, rule, state, action))
            state = next_state
            if terminated:
                break
    return largest


def noise_floor(
    task: str, q_src: NDArray[np.float64], rule: DeltaRule, gamma: float, episodes: int, seed: int
) -> float:
    """Return the largest delta that the gate of `rule` sees on the source task `task`, following argmax q_src (S, A).

    Random numbers come from a separate stream, derived from `seed` and the source task.
    """
    dynamics = parse_task(task).dynamics()
    source = SourceTables(np.array(q_src), q_src.max(axis=1), q_src.argmax(axis=1))
    rng = stream(seed, "calibration", task)
    where = dynamics.kind, dynamics.parameters, dynamics.start, dynamics.time_limit
    tables = (tabular_estimator.empty_table(*q_src.shape) for _ in range(RUNS))
    return max(float(_largest(*where, source, table, rule, gamma, episodes, rng)) for table in tables)


FLOOR_EPISODES = 10
"""Default number of episodes on the source's own task."""


@dataclass(frozen=True)
class Episode:
    """Statistics of one episode in which a source was followed."""

    path_delta: float
    """sum_t gamma^t delta(s_t, a_t): the discounted return minus the predicted return V_src(s_0)."""
    promise: float
    """The predicted return V_src(s_0)."""
    mean_abs: float
    """Mean |delta| over its steps."""
    mean_square: float
    """Mean delta^2 over its steps."""
    steps: int


@dataclass(frozen=True)
class SelfDelta:
    """delta of a source on its own task, which is due to the source's errors alone."""

    mean_abs: float
    """Mean over all steps of |delta|."""
    root_mean_square: float
    """Root of the mean over all steps of delta^2."""
    episodes: tuple[Episode, ...]


def episode_of(source: Values, seen: Transitions, gamma: float) -> Episode:
    """Return the statistics of an episode from its transitions, in order, and the source that was followed."""
    samples = delta_samples(source, seen, gamma).astype(np.float64)
    discounts = gamma ** np.arange(len(samples))
    promise = float(source.rows(seen.observations[:1]).max())
    mean_abs, mean_square = float(np.abs(samples).mean()), float((samples**2).mean())
    return Episode(float(discounts @ samples), promise, mean_abs, mean_square, len(samples))


def self_delta(
    source: Values, task: str, gamma: float, seed: int, episodes: int = FLOOR_EPISODES, epsilon: float = 0.0
) -> SelfDelta:
    """Return delta of a source on its own `task`, from episodes of its epsilon-greedy policy with a separate stream."""
    from trainables.tasks.rollout import Rollout

    with Rollout(parse_task(task), stream(seed, "calibration", task)) as rollout:
        found = tuple(episode_of(source, rollout.episode(source, epsilon), gamma) for _ in range(episodes))
    steps = sum(episode.steps for episode in found)
    mean_abs = math.fsum(episode.mean_abs * episode.steps for episode in found) / steps
    square = math.fsum(episode.mean_square * episode.steps for episode in found) / steps
    return SelfDelta(mean_abs, math.sqrt(square), found)
