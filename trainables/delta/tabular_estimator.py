"""The tabular estimators of delta, eq. (2), and the count of pairs over the threshold, on which the gates depend."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from trainables.numerics.jit import compiled


class DeltaTable(NamedTuple):
    """delta of every (s,a), and its noise for the confidence gate. All arrays are (S, A)."""

    delta: NDArray[np.float64]
    visits: NDArray[np.int64]
    squares: NDArray[np.float64]
    """Sum of squared deviations of the samples from their mean (Welford); only for the confidence gate."""
    over: NDArray[np.bool_]
    """Whether the pair is over the threshold."""


class DeltaRule(NamedTuple):
    """How a sample updates delta, and when a pair is over the threshold."""

    confident: bool
    """False: eq. (2) with learning_rate, over iff |delta| > threshold. True: running mean, over iff significant."""
    learning_rate: float
    """alpha_d."""
    threshold: float
    """Delta; infinity for an agent without a gate."""
    z: float
    min_visits: int
    sd_floor: float


def empty_table(states: int, actions: int) -> DeltaTable:
    """Return a table with delta = 0 everywhere: the prior belief that source and target are equal."""
    shape = (states, actions)
    return DeltaTable(np.zeros(shape), np.zeros(shape, np.int64), np.zeros(shape), np.zeros(shape, np.bool_))


@compiled
def size(table: DeltaTable, rule: DeltaRule, state: int, action: int) -> float:
    """Return what is compared with the threshold: |delta|, or for the confidence gate |mean| - z se (or 0)."""
    largest: float = abs(table.delta[state, action])
    if not rule.confident:
        return largest
    visits = table.visits[state, action]
    if visits < rule.min_visits:
        return 0.0
    sd = max(math.sqrt(table.squares[state, action] / visits), rule.sd_floor)
    return float(largest - rule.z * sd / math.sqrt(visits))


@compiled
def update(table: DeltaTable, rule: DeltaRule, state: int, action: int, sample: float) -> int:
    """Update delta by a sample r + gamma V_src(s') - Q_src(s,a); return the change in pairs over the threshold."""
    visits = table.visits[state, action] + 1
    table.visits[state, action] = visits
    error = sample - table.delta[state, action]
    if rule.confident:
        table.delta[state, action] += error / visits
        table.squares[state, action] += error * (sample - table.delta[state, action])
    else:
        table.delta[state, action] += rule.learning_rate * error
    over = size(table, rule, state, action) > rule.threshold
    change = int(over) - int(table.over[state, action])
    table.over[state, action] = over
    return change
