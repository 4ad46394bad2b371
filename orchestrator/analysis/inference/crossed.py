"""Source networks crossed with target seeds: both are random, and neither is a repetition of the other.

A table (sources, seeds) has one number per source network and target seed. Its model is y_ij = m + a_i + b_j + e_ij
with independent random effects of the source, of the seed, and the rest. An interval that took all cells for
independent would be far too narrow: one source network changes its whole row.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from scipy import optimize

from orchestrator.analysis import statistics
from orchestrator.analysis.statistics import LEVEL, Estimate, TransferRatio, tested

Table = NDArray[np.float64]
"""(sources, seeds)"""


BY = ["source_cell", "seed"]
"""The columns that say which source network and which seed a cell has."""


def rectangle(cells: pd.DataFrame, column: str) -> Table:
    """Return a column of cells by their source network (rows) and seed, as (sources, seeds).

    cells: with the columns `seed` and `source_cell`. One row where no seed has two source networks: then each seed is
    one draw of everything, its source included. Else every source network that has all the seeds; and where none has,
    the seeds that all of them have.
    """
    if not cells["seed"].duplicated().any():
        return cells[column].to_numpy(np.float64)[None, np.argsort(cells["seed"].to_numpy(), kind="stable")]
    numbers = cells[BY].assign(**{column: cells[column].astype(np.float64)})
    table = numbers.pivot_table(index="source_cell", columns="seed", values=column, sort=True)
    whole = table.dropna()
    return (whole if len(whole) > 1 else table.dropna(axis=1)).to_numpy(np.float64)


DRAWS = 10_000
"""Draws of the chi-squares behind an interval of a variance component."""


@dataclass(frozen=True)
class Components:
    """How much of the variance of one cell lies between source networks, between seeds, and in neither; shares of 1."""

    sources: Estimate
    seeds: Estimate
    rest: Estimate


def components(table: Table) -> Components | None:
    """Return the shares of variance by analysis of variance, with generalised confidence intervals.

    The components are those of the method of moments, which are restricted maximum likelihood's where none is below 0;
    what is, counts as 0. The intervals are quantiles of the same formula with each mean square divided by a draw of
    chi-square over its degrees of freedom (S. Weerahandi, "Exact Statistical Methods for Data Analysis", 1995): a
    bootstrap over five sources would be too narrow. None for one source network or one seed, and without any variance.
    """
    sources, seeds = table.shape
    if min(sources, seeds) < 2:
        return None
    squares = np.array(mean_squares(table))
    freedom = np.array([sources - 1, seeds - 1, (sources - 1) * (seeds - 1)])
    if not squares.any():
        return None
    chi = np.random.default_rng(0).chisquare(freedom, (DRAWS, 3))
    value = _shares(squares[None], sources, seeds)[0]
    ends = np.quantile(_shares(freedom * squares / chi, sources, seeds), [(1 - LEVEL) / 2, (1 + LEVEL) / 2], axis=0)
    return Components(*(Estimate(float(v), float(a), float(b)) for v, a, b in zip(value, *ends, strict=True)))


def _shares(squares: Table, sources: int, seeds: int) -> Table:
    """Return mean squares (draws, 3) as shares of variance between sources, between seeds and of the rest."""
    between, within, rest = squares.T
    parts = np.stack([np.maximum(between - rest, 0) / seeds, np.maximum(within - rest, 0) / sources, rest], axis=1)
    shares: Table = parts / parts.sum(axis=1, keepdims=True)
    return shares


def mean_squares(table: Table) -> tuple[float, float, float]:
    """Return the mean squares between sources, between seeds, and of the rest, of a two-way analysis of variance."""
    sources, seeds = table.shape
    rows, columns, centre = table.mean(axis=1, keepdims=True), table.mean(axis=0, keepdims=True), table.mean()
    rest = table - rows - columns + centre
    return (
        float(seeds * ((rows - centre) ** 2).sum() / (sources - 1)),
        float(sources * ((columns - centre) ** 2).sum() / (seeds - 1)),
        float((rest**2).sum() / ((sources - 1) * (seeds - 1))),
    )


def mean(table: Table) -> Estimate:
    """Return the mean over sources and seeds with an interval and p-value for which both are random, by Student's t."""
    return tested(float(table.mean()), *standard_error(table))


def standard_error(table: Table) -> tuple[float | None, float]:
    """Return the standard error of the mean over sources and seeds, None for one cell, and its degrees of freedom.

    Var(mean) = (MS_sources + MS_seeds - MS_rest) / (sources seeds), components below 0 taken for 0, with
    Satterthwaite's degrees of freedom; over seeds alone for one source network, over networks alone for one seed.
    """
    sources, seeds = table.shape
    if min(sources, seeds) == 1:
        n = max(sources, seeds)
        return float(table.std(ddof=1)) / math.sqrt(n) if n > 1 else None, n - 1
    between, within, rest = mean_squares(table)
    between, within = max(between, rest), max(within, rest)
    spread = between + within - rest
    parts = between**2 / (sources - 1) + within**2 / (seeds - 1) + rest**2 / ((sources - 1) * (seeds - 1))
    df = spread**2 / parts if parts > 0 else float(min(sources, seeds) - 1)
    return math.sqrt(spread / table.size), df


WIDEST = 1e9
"""A ratio of two means beyond this many times its own size is not looked for."""


def transfer_ratio(with_transfer: Table, without: Table) -> TransferRatio:
    """Return the transfer ratio of two tables (sources, seeds), for which sources and seeds are both random.

    Fieller's argument with `mean` in place of Student's t: the interval holds every ratio r for which the mean of
    A_t - r A_w is within its own interval of 0. For one source network it is Fieller's own, over seeds.
    """
    if len(with_transfer) == 1:
        return statistics.transfer_ratio(list(with_transfer[0]), list(without[0]))
    over_seeds = statistics.transfer_ratio(list(with_transfer.mean(axis=0)), list(without.mean(axis=0)))
    if over_seeds.value is None or over_seeds.low is None:
        return over_seeds
    base = float(without.mean())
    ratio = float(with_transfer.mean()) / base

    def outside(r: float) -> float:
        gap = mean(with_transfer - r * without)
        assert gap.low is not None
        assert gap.high is not None
        return max(gap.low, -gap.high)

    if outside(ratio) == 0:
        return over_seeds
    ends = (_zero(outside, ratio, side) for side in (-1.0, 1.0))
    low, high = sorted(math.copysign(1.0, base) * (end - 1.0) for end in ends)
    return TransferRatio(over_seeds.value, low, high)


def _zero(outside: Callable[[float], float], ratio: float, side: float) -> float:
    """Return where `outside`, below 0 at `ratio`, rises to 0 on one side of it."""
    step = 1e-3 * max(abs(ratio), 1e-3)
    while outside(ratio + side * step) < 0:
        step *= 2
        if step > WIDEST * max(abs(ratio), 1.0):
            return side * math.inf
    return float(optimize.brentq(outside, ratio, ratio + side * step, xtol=1e-12))
