"""The noise floor of a source: what a gate's estimate of delta comes to on the source's own task, where delta is 0.

A learned source errs, and a gate with a small learning rate still sees the noise of single samples. Both make |delta|
large where the tasks are equal. `threshold: auto` is the largest value that the gate would have met in as many episodes
on the source task, following the source, in RUNS runs: the smallest threshold that would not have closed it in any.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from trainables.cell import Cell
from trainables.delta import tabular
from trainables.delta.tabular import DeltaRule, DeltaTable
from trainables.jit import compiled
from trainables.streams import stream
from trainables.tasks import parse_task
from trainables.tasks.dynamics import step as env_step

RUNS = 10
"""Runs whose largest delta is taken: of one alone, every second new run would meet a larger one."""


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
            tabular.update(table, rule, state, action, reward + gamma * v_next - source.q[state, action])
            largest = max(largest, tabular.size(table, rule, state, action))
            state = next_state
            if terminated:
                break
    return largest


def noise_floor(
    task: str, q_src: NDArray[np.float64], rule: DeltaRule, gamma: float, episodes: int, seed: int
) -> float:
    """The largest delta that the gate of `rule` meets on the source task `task`, following argmax of q_src (S, A).

    Random numbers come from a stream of their own, by `seed` and the source task.
    """
    dynamics = parse_task(task).dynamics()
    source = SourceTables(np.array(q_src), q_src.max(axis=1), q_src.argmax(axis=1))
    rng = stream(seed, "calibration", task)
    where = dynamics.kind, dynamics.parameters, dynamics.start, dynamics.time_limit
    tables = (tabular.empty_table(*q_src.shape) for _ in range(RUNS))
    return max(float(_largest(*where, source, table, rule, gamma, episodes, rng)) for table in tables)


def calibrated(cell: Cell, q_src: NDArray[np.float64], rule: DeltaRule) -> DeltaRule:
    """The rule with the noise floor of the cell's source over as many episodes as the cell has."""
    settings = cell.settings
    floor = noise_floor(cell.sources[0].task, q_src, rule, settings.gamma, settings.episodes, cell.seed)
    return rule._replace(threshold=floor)
