"""Aggregates of normalised scores over tasks, as in rliable: stratified, so that no task's chance is another's.

R. Agarwal et al., "Deep Reinforcement Learning at the Edge of the Statistical Precipice", NeurIPS 2021. Scores are a
table (sources, seeds) per task, of one row where source networks are not crossed with seeds. A resample draws seeds
within each task, and source networks too where there are several (A. B. Owen, "The pigeonhole bootstrap", 2007).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from orchestrator.analysis.inference.crossed import Table
from orchestrator.analysis.statistics import LEVEL, RESAMPLES, Estimate, probability_of_improvement

Scores = Sequence[Table]
"""One table of normalised scores per task."""
Array = NDArray[np.float64]

SOLVED = 1.0
"""The normalised score of a solution."""


def iqm(scores: Scores) -> Estimate:
    """Return the interquartile mean of all runs of all tasks: the mean of the middle half."""
    return _bootstrapped(scores, lambda tables: stats.trim_mean(_flat(tables), 0.25, axis=-1))


def mean(scores: Scores) -> Estimate:
    """Return the mean over tasks of the means over runs."""
    return _bootstrapped(scores, lambda tables: _task_means(tables).mean(axis=-1))


def median(scores: Scores) -> Estimate:
    """Return the median over tasks of the means over runs."""
    return _bootstrapped(scores, lambda tables: np.median(_task_means(tables), axis=-1))


def optimality_gap(scores: Scores) -> Estimate:
    """Return by how much runs fall short of a solution on average; what exceeds one counts as one."""
    return _bootstrapped(scores, lambda tables: SOLVED - np.minimum(_flat(tables), SOLVED).mean(axis=-1))


def profile(scores: Scores, thresholds: Sequence[float]) -> tuple[Array, Array, Array]:
    """Return the share of runs with a score above each threshold, and its pointwise interval: (value, low, high)."""
    levels = np.asarray(thresholds, np.float64)
    runs, drawn = _flat(scores), _flat(_resampled(scores))
    value = np.array([(runs > level).mean() for level in levels])
    shares = np.stack([(drawn > level).mean(axis=-1) for level in levels])
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


def _task_means(tables: Scores) -> Array:
    return np.stack([table.mean(axis=(-2, -1)) for table in tables], axis=-1)


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
