"""Statistics over seeds. Every function takes one number per seed, and raises ValueError for a NaN.

With five seeds, a nominal 95 % percentile bootstrap interval of a mean covers about 83 %. Therefore means and paired
differences have Student's t intervals, the transfer ratio has Fieller's (the exact interval of a ratio of paired
normal means), the probability of improvement has Newcombe's score interval (which stays wide even where every run
with transfer beats every run without: two seeds never give [1, 1]), and only the interquartile mean is bootstrapped.

Two numbers that differ by at most the share TIE of the larger one count as equal, since sums are rounded.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import optimize, stats

LEVEL = 0.95
"""Confidence level of every interval."""
RESAMPLES = 2000
TIE = 1e-9
"""Numbers that differ by at most this share of the larger one count as equal."""
MIN_PAIRS = 5
"""Pairs that the interval of a rank correlation needs."""


@dataclass(frozen=True)
class Estimate:
    """A number with its interval; low and high are None where there are too few seeds for one."""

    value: float
    low: float | None
    high: float | None
    sd: float | None = None
    """Standard deviation over seeds, where it is shown next to the number."""
    p: float | None = None
    """Two-sided p-value against 0, of a difference."""
    at_least: bool | None = None
    """Whether the number is a lower bound: some runs ended before they got there."""
    df: float | None = None
    """Degrees of freedom of its t distribution, of a difference."""


@dataclass(frozen=True)
class TransferRatio:
    """tr = (A_t - A_w) / |A_w|. All numbers are None, with a reason, where the interval of A_w touches 0."""

    value: float | None
    low: float | None
    high: float | None
    undefined: str | None = None


def _array(values: Sequence[float]) -> NDArray[np.float64]:
    array = np.asarray(values, dtype=np.float64)
    if not len(array) or not np.isfinite(array).all():
        raise ValueError(f"statistics need finite numbers, at least one (got {list(values)})")
    return array


def sd(values: Sequence[float]) -> float:
    """Return the standard deviation over seeds, with n - 1 in the denominator; 0 for one seed."""
    array = _array(values)
    return float(array.std(ddof=1)) if len(array) > 1 else 0.0


def mean(values: Sequence[float]) -> Estimate:
    """Return the mean with Student's t interval."""
    array = _array(values)
    centre = float(array.mean())
    if len(array) < 2:
        return Estimate(centre, None, None)
    half = float(stats.t.ppf((1 + LEVEL) / 2, len(array) - 1)) * sd(values) / math.sqrt(len(array))
    return Estimate(centre, centre - half, centre + half)


def difference(with_transfer: Sequence[float], without: Sequence[float]) -> Estimate:
    """Return the mean of A_t - A_w, paired by seed, with Student's t interval and p-value; a tie is 0."""
    gaps = differences(with_transfer, without)
    spread = float(gaps.std(ddof=1)) / math.sqrt(len(gaps)) if len(gaps) > 1 else None
    return tested(float(gaps.mean()), spread, len(gaps) - 1)


def differences(with_transfer: Sequence[float], without: Sequence[float]) -> NDArray[np.float64]:
    """Return A_t - A_w of each pair; a tie is a difference of 0."""
    a_t, a_w = _array(with_transfer), _array(without)
    return np.where(_tied(a_t, a_w), 0.0, a_t - a_w)


def tested(value: float, error: float | None, df: float) -> Estimate:
    """Return a number with Student's t interval and its p-value against 0.

    error: its standard error; None where there is none, and so no interval.
    """
    if error is None:
        return Estimate(value, None, None)
    half = float(stats.t.ppf((1 + LEVEL) / 2, df)) * error
    ratio = abs(value) / error if error > 0 else math.inf if value else 0.0
    p = 2 * float(stats.t.sf(ratio, df))
    return Estimate(value, value - half, value + half, p=p, df=df)


def _tied(x: NDArray[np.float64], y: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Return whether numbers are equal up to TIE, elementwise."""
    return np.abs(x - y) <= TIE * np.maximum(np.abs(x), np.abs(y))


def transfer_ratio(with_transfer: Sequence[float], without: Sequence[float]) -> TransferRatio:
    """Return the transfer ratio of the mean AUCs, paired by seed, with Fieller's interval.

    It is undefined where the interval of A_w touches 0, which is exactly where Fieller's interval is unbounded.
    """
    a_t, a_w = _array(with_transfer), _array(without)
    a_t = np.where(_tied(a_t, a_w), a_w, a_t)
    base = mean(list(a_w))
    if base.low is None or base.high is None:
        return _single(float(a_t.mean()), base.value)
    if base.low <= 0 <= base.high:
        return TransferRatio(None, None, None, "the interval of the AUC without transfer touches 0")
    n, t = len(a_t), float(stats.t.ppf((1 + LEVEL) / 2, len(a_t) - 1))
    covariance = np.cov(a_t, a_w, ddof=1) / n
    g = t**2 * covariance[1, 1] / base.value**2
    ratio = float(a_t.mean()) / base.value
    slope = covariance[0, 1] / covariance[1, 1] if covariance[1, 1] > 0 else 0.0
    spread = covariance[0, 0] - 2 * ratio * covariance[0, 1] + ratio**2 * covariance[1, 1]
    spread -= g * (covariance[0, 0] - slope * covariance[0, 1])
    shift = g * slope
    half = t / abs(base.value) * math.sqrt(max(spread, 0.0))
    low, high = sorted(_to_tr(end / (1 - g), base.value) for end in (ratio - shift - half, ratio - shift + half))
    return TransferRatio(_to_tr(ratio, base.value), low, high)


def _to_tr(ratio: float, base: float) -> float:
    """Return (A_t - A_w) / |A_w| for the ratio A_t / A_w."""
    return math.copysign(1.0, base) * (float(ratio) - 1.0) + 0.0  # no minus before a 0


def _single(a_t: float, a_w: float) -> TransferRatio:
    if a_w == 0:
        return TransferRatio(None, None, None, "the AUC without transfer is 0")
    return TransferRatio((a_t - a_w) / abs(a_w), None, None)


def iqm(values: Sequence[float]) -> Estimate:
    """Return the interquartile mean with a bootstrap interval over seeds."""
    array = _array(values)
    resampled = array[_draws(len(array), len(array))]
    return _bootstrapped(float(stats.trim_mean(array, 0.25)), stats.trim_mean(resampled, 0.25, axis=1), len(array))


def probability_of_improvement(
    with_transfer: Sequence[float], without: Sequence[float], independent: tuple[int, int] | None = None
) -> Estimate:
    """Return P(a run with transfer beats one without), ties counted half, with Newcombe's score interval.

    independent: number of independent runs on each side, where not all of them are.

    The interval is method 5 of R. G. Newcombe, "Confidence intervals for an effect size measure based on the
    Mann-Whitney statistic, part 2", Statistics in Medicine 25 (2006): all theta within z standard errors of the
    estimate, with the standard error evaluated at theta.
    """
    x, y = _array(with_transfer)[:, None], _array(without)[None, :]
    wins = np.where(_tied(x, y), 0.5, x > y)
    value = float(wins.mean())
    sizes = independent or wins.shape
    if min(sizes) < 2:
        return Estimate(value, None, None)
    low = _score_end(value, 0.0, *sizes) if value > 0 else 0.0
    high = _score_end(value, 1.0, *sizes) if value < 1 else 1.0
    return Estimate(value, low, high)


def _score_end(value: float, end: float, m: int, n: int) -> float:
    """Return the theta between `value` and `end` that is z standard errors away from `value`."""
    z2, extra = float(stats.norm.ppf((1 + LEVEL) / 2)) ** 2, (m + n) / 2 - 1

    def beyond(theta: float) -> float:
        spread = 1 + extra * ((1 - theta) / (2 - theta) + theta / (1 + theta))
        return (theta - value) ** 2 - z2 * theta * (1 - theta) * spread / (m * n)

    near = value + math.copysign(1e-12, end - value)
    return float(optimize.brentq(beyond, near, end))


def rank_correlation(x: Sequence[float], y: Sequence[float]) -> Estimate | None:
    """Return Spearman's rank correlation of pairs, with a bootstrap interval over the pairs, or None.

    None for fewer than three pairs, or where one side is constant; no interval below MIN_PAIRS. Resamples in which one
    side is constant have no correlation and are left out.
    """
    a, b = _array(x), _array(y)
    if len(a) < 3 or np.ptp(a) == 0 or np.ptp(b) == 0:
        return None
    if len(a) < MIN_PAIRS:
        return Estimate(float(_spearman(a[None], b[None])[0]), None, None)
    draws = _draws(len(a), 0)
    varied = draws[(np.ptp(a[draws], axis=1) > 0) & (np.ptp(b[draws], axis=1) > 0)]
    value = float(_spearman(a[None], b[None])[0])
    return _bootstrapped(value, _spearman(a[varied], b[varied]), len(a))


def _spearman(x: NDArray[np.float64], y: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the rank correlation (rows,) of each row of x with the same row of y, both (rows, n)."""
    ranks = [stats.rankdata(side, axis=1) for side in (x, y)]
    p, q = (side - side.mean(axis=1, keepdims=True) for side in ranks)
    correlation: NDArray[np.float64] = (p * q).sum(axis=1) / np.sqrt((p**2).sum(axis=1) * (q**2).sum(axis=1))
    return correlation


def _draws(n: int, seed: int) -> NDArray[np.int64]:
    return np.random.default_rng(seed).integers(0, n, (RESAMPLES, n))


def _bootstrapped(value: float, resampled: NDArray[np.float64], n: int) -> Estimate:
    """Return an estimate with its percentile interval, which unlike BCa is defined where all seeds are equal."""
    if n < 2:
        return Estimate(value, None, None)
    low, high = np.quantile(resampled, [(1 - LEVEL) / 2, (1 + LEVEL) / 2])
    return Estimate(value, float(low), float(high))
