"""Aggregates of normalised scores over tasks, as in rliable: stratified, so that no task's chance is another's.

R. Agarwal et al., "Deep Reinforcement Learning at the Edge of the Statistical Precipice", NeurIPS 2021. Scores are a
table (sources, seeds) per task, of one row where source networks are not crossed with seeds. A resample draws seeds
within each task, and source networks too where there are several (A. B. Owen, "The pigeonhole bootstrap", 2007).

Every task weighs the same, also where one has more runs than another. With as many runs on each, the numbers are
rliable's.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from orchestrator.analysis.inference.crossed import Table
from orchestrator.analysis.statistics import LEVEL, RESAMPLES, Estimate, probability_of_improvement

Scores = Sequence[Table]
"""One table of normalised scores per task."""
Array = NDArray[np.float64]

SOLVED = 1.0
"""The normalised score of a solution."""


def iqm(scores: Scores) -> Estimate:
    """Return the interquartile mean of all runs of all tasks: the mean of the middle half."""
    return _bootstrapped(scores, _middle)


def _middle(tables: Scores) -> Array:
    """Return the mean of what is left of all runs without a quarter of their weight at each end.

    A quarter is rounded down to whole runs, as in scipy's trim_mean.
    """
    runs, weights = _flat(tables), _weights(tables)
    order = runs.argsort(axis=-1)
    ends = weights[order].cumsum(axis=-1)
    cut = int(0.25 * weights.size) / weights.size
    left = np.clip(ends, cut, 1 - cut) - np.clip(ends - weights[order], cut, 1 - cut)
    return np.asarray((np.take_along_axis(runs, order, axis=-1) * left).sum(axis=-1) / left.sum(axis=-1))


def mean(scores: Scores) -> Estimate:
    """Return the mean over tasks of the means over runs."""
    return _bootstrapped(scores, _mean)


def median(scores: Scores) -> Estimate:
    """Return the median over tasks of the means over runs."""
    return _bootstrapped(scores, lambda tables: np.median(_task_means(tables), axis=-1))


def optimality_gap(scores: Scores) -> Estimate:
    """Return by how much runs fall short of a solution on average; what exceeds one counts as one."""
    return _bootstrapped(scores, lambda tables: SOLVED - _mean([np.minimum(each, SOLVED) for each in tables]))


def profile(scores: Scores, thresholds: Sequence[float]) -> tuple[Array, Array, Array]:
    """Return the share of runs with a score above each threshold, and its pointwise interval: (value, low, high)."""
    levels = np.asarray(thresholds, np.float64)
    drawn = _resampled(scores)
    value = np.array([_mean([table > level for table in scores]) for level in levels])
    shares = np.stack([_mean([table > level for table in drawn]) for level in levels])
    low, high = np.quantile(shares, [(1 - LEVEL) / 2, (1 + LEVEL) / 2], axis=1)
    return value, low, high


def improvement(x: Scores, y: Scores) -> Estimate:
    """Return P(a run of X beats one of Y on the same task), averaged over tasks; ties count half.

    Its interval combines Newcombe's of each task (G. Y. Zou and A. Donner, "Construction of confidence limits about
    effect measures", Statistics in Medicine 27, 2008). A bootstrap would say [1, 1] where every run of X beats every
    one of Y, however few they are.
    """
    tasks = [
        probability_of_improvement(list(a.ravel()), list(b.ravel()), (a.shape[1], b.shape[1]))
        for a, b in zip(x, y, strict=True)
    ]
    value = float(np.mean([task.value for task in tasks]))
    if any(task.low is None or task.high is None for task in tasks):
        return Estimate(value, None, None)
    down = math.sqrt(sum((task.value - (task.low or 0.0)) ** 2 for task in tasks)) / len(tasks)
    up = math.sqrt(sum(((task.high or 0.0) - task.value) ** 2 for task in tasks)) / len(tasks)
    return Estimate(value, value - down, value + up)


def _flat(tables: Scores) -> Array:
    """Return the runs of all tasks in one last axis."""
    return np.concatenate([table.reshape(*table.shape[:-2], -1) for table in tables], axis=-1)


def _weights(tables: Scores) -> Array:
    """Return the weight of each run in `_flat`, the same for every task; their sum is 1."""
    counts = [table.shape[-2] * table.shape[-1] for table in tables]
    return np.concatenate([np.full(count, 1 / (len(counts) * count)) for count in counts])


def _task_means(tables: Sequence[NDArray[Any]]) -> Array:
    return np.stack([table.mean(axis=(-2, -1)) for table in tables], axis=-1)


def _mean(tables: Sequence[NDArray[Any]]) -> Array:
    """Return the mean over tasks of the means over runs."""
    return np.asarray(_task_means(tables).mean(axis=-1))


def _resampled(scores: Scores) -> list[Array]:
    """Return RESAMPLES draws of each task's runs, (resamples, sources, seeds)."""
    rng, drawn = np.random.default_rng(0), []
    for table in scores:
        sources, seeds = table.shape
        rows = rng.integers(0, sources, (RESAMPLES, sources)) if sources > 1 else np.zeros((RESAMPLES, 1), np.int64)
        columns = rng.integers(0, seeds, (RESAMPLES, seeds))
        drawn.append(table[rows[:, :, None], columns[:, None, :]])
    return drawn


def _bootstrapped(scores: Scores, statistic: Callable[[Scores], Array]) -> Estimate:
    """Return a statistic with its percentile interval; none for tasks of one run each."""
    value = float(statistic(scores))
    if all(table.size < 2 for table in scores):
        return Estimate(value, None, None)
    low, high = np.quantile(statistic(_resampled(scores)), [(1 - LEVEL) / 2, (1 + LEVEL) / 2])
    return Estimate(value, float(low), float(high))
