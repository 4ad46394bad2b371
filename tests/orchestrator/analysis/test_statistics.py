"""Intervals that cover what they say, and no number where there is none."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import stats

from orchestrator.analysis import statistics

numbers = st.floats(-1e3, 1e3).map(lambda value: round(value, 3))
samples = st.lists(numbers, min_size=2, max_size=8)


def test_the_interval_of_a_mean_is_students_t() -> None:
    values = [1.0, 2.0, 4.0, 8.0]
    expected = stats.t.interval(0.95, 3, loc=np.mean(values), scale=stats.sem(values))
    estimate = statistics.mean(values)
    assert (estimate.low, estimate.high) == pytest.approx(expected)


def test_one_seed_has_no_interval() -> None:
    assert statistics.mean([3.0]) == statistics.Estimate(3.0, None, None)
    assert statistics.transfer_ratio([3.0], [2.0]) == statistics.TransferRatio(0.5, None, None)
    assert statistics.iqm([3.0]).low is None


@pytest.mark.parametrize("bad", [[], [1.0, math.nan], [math.inf, 1.0]])
def test_a_nan_is_refused_and_never_averaged_away(bad: list[float]) -> None:
    for function in (statistics.mean, statistics.iqm, statistics.sd):
        with pytest.raises(ValueError, match="finite"):
            function(bad)


def test_equal_seeds_give_a_point_and_not_a_nan() -> None:
    for function in (statistics.mean, statistics.iqm):
        estimate = function([200.0] * 5)
        assert (estimate.value, estimate.low, estimate.high) == (200.0, 200.0, 200.0)
    assert statistics.transfer_ratio([150.0] * 5, [100.0] * 5) == statistics.TransferRatio(0.5, 0.5, 0.5)


def test_the_transfer_ratio_keeps_its_sign_for_negative_returns() -> None:
    ratio = statistics.transfer_ratio([-50.0, -51.0, -49.0], [-100.0, -101.0, -99.0])
    assert ratio.value == pytest.approx(0.5)
    assert ratio.low is not None
    assert ratio.high is not None
    assert ratio.low < 0.5 < ratio.high


def test_the_transfer_ratio_is_undefined_where_the_base_may_be_zero() -> None:
    ratio = statistics.transfer_ratio([5.0, 6.0, 7.0], [-1.0, 0.5, 1.0])
    assert ratio.value is None
    assert ratio.undefined is not None
    assert "touches 0" in ratio.undefined


@pytest.mark.parametrize("base", [-70.0, 40.0])
def test_fiellers_interval_covers_the_true_ratio_as_often_as_it_says(base: float) -> None:
    rng = np.random.default_rng(0)
    target, hits, runs = -50.0, 0, 1500
    truth = (target - base) / abs(base)
    for _ in range(runs):
        shared = 3 * rng.normal(size=5)
        ratio = statistics.transfer_ratio(
            target + shared + 4 * rng.normal(size=5), base + shared + 5 * rng.normal(size=5)
        )
        assert ratio.low is not None
        assert ratio.high is not None
        hits += ratio.low <= truth <= ratio.high
    assert 0.93 < hits / runs < 0.97


@given(samples)
def test_the_difference_from_oneself_is_zero(values: list[float]) -> None:
    gap = statistics.difference(values, values)
    assert (gap.value, gap.low, gap.high) == (0.0, 0.0, 0.0)


@given(samples, samples)
def test_improvement_and_its_converse_sum_to_one(x: list[float], y: list[float]) -> None:
    forth, back = statistics.probability_of_improvement(x, y), statistics.probability_of_improvement(y, x)
    assert forth.value + back.value == pytest.approx(1.0)
    assert 0 <= forth.value <= 1


def test_a_difference_of_rounding_is_no_win() -> None:
    base, same = [-200.0] * 4, [-199.99999999974] * 4
    chance = statistics.probability_of_improvement(same, base)
    assert chance.value == 0.5
    assert chance.low is not None
    assert chance.high is not None
    assert chance.low < 0.5 < chance.high
    assert statistics.difference(same, base) == statistics.Estimate(0.0, 0.0, 0.0, p=1.0, df=3)
    assert statistics.transfer_ratio(same, base) == statistics.TransferRatio(0.0, 0.0, 0.0)


@pytest.mark.parametrize(("seeds", "low"), [(2, 0.386), (5, 0.643), (20, 0.899)])
def test_two_seeds_never_make_an_improvement_sure(seeds: int, low: float) -> None:
    chance = statistics.probability_of_improvement([1.0] * seeds, [0.0] * seeds)
    assert (chance.value, chance.low, chance.high) == (1.0, pytest.approx(low, abs=1e-3), 1.0)


@pytest.mark.parametrize("shift", [0.0, 1.0, 2.0])
def test_newcombes_interval_covers_the_probability_as_often_as_it_says(shift: float) -> None:
    rng, truth, hits, runs = np.random.default_rng(0), stats.norm.cdf(shift / math.sqrt(2)), 0, 600
    for _ in range(runs):
        chance = statistics.probability_of_improvement(rng.normal(shift, 1, 5), rng.normal(0, 1, 5))
        assert chance.low is not None
        assert chance.high is not None
        hits += chance.low <= truth <= chance.high
    assert 0.92 < hits / runs < 0.99


@given(samples)
def test_the_interquartile_mean_lies_between_the_extremes(values: list[float]) -> None:
    estimate = statistics.iqm(values)
    assert min(values) - 1e-9 <= estimate.value <= max(values) + 1e-9


def test_the_same_seeds_give_the_same_bootstrap() -> None:
    assert statistics.iqm([1.0, 5.0, 2.0]) == statistics.iqm([1.0, 5.0, 2.0])


@given(st.lists(st.tuples(numbers, numbers), min_size=5, max_size=9))
def test_a_rank_correlation_is_spearmans_within_its_interval(pairs: list[tuple[float, float]]) -> None:
    x, y = [list(side) for side in zip(*pairs, strict=True)]
    estimate = statistics.rank_correlation(x, y)
    if len(set(x)) == 1 or len(set(y)) == 1:
        assert estimate is None
        return
    assert estimate is not None
    assert estimate.value == pytest.approx(stats.spearmanr(x, y).statistic)
    assert estimate.low is not None
    assert estimate.high is not None
    assert -1 - 1e-9 <= estimate.low <= estimate.high <= 1 + 1e-9


def test_two_targets_have_no_rank_correlation_and_a_clear_order_has_a_sure_one() -> None:
    assert statistics.rank_correlation([1.0, 2.0], [2.0, 1.0]) is None
    assert statistics.rank_correlation([1.0, 2.0, 3.0], [2.0, 1.0, 0.0]) == statistics.Estimate(-1.0, None, None)
    clear = statistics.rank_correlation([1.0, 2.0, 3.0, 4.0, 5.0], [9.0, 7.0, 5.0, 3.0, 1.0])
    assert clear is not None
    assert (clear.value, clear.low, clear.high) == pytest.approx((-1.0, -1.0, -1.0))
