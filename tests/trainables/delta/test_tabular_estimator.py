"""The estimators of delta against their formulas, and the counter of pairs over the threshold against a recount."""

from __future__ import annotations

import math
from collections import defaultdict

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from trainables.delta.tabular_estimator import DeltaRule, DeltaTable, empty_table, update

SHAPE = (3, 2)
samples = st.lists(st.tuples(st.integers(0, 2), st.integers(0, 1), st.floats(-30, 30)), max_size=120)


def _eq_2(threshold: float, learning_rate: float = 0.5) -> DeltaRule:
    return DeltaRule(False, learning_rate, threshold, 0.0, 0, 0.0)


def _confident(threshold: float = 1.0, z: float = 3.0, min_visits: int = 5, sd_floor: float = 0.3) -> DeltaRule:
    return DeltaRule(True, 0.0, threshold, z, min_visits, sd_floor)


def _feed(rule: DeltaRule, values: list[float]) -> tuple[DeltaTable, list[bool]]:
    """Samples of one pair; whether the gate is closed after each."""
    table = empty_table(1, 1)
    changes = [update(table, rule, 0, 0, value) for value in values]
    return table, [bool(count) for count in np.cumsum(changes)]


@settings(deadline=None)
@given(samples, st.floats(0, 20), st.floats(0.01, 1))
def test_eq_2_and_the_counter_is_positive_iff_the_largest_delta_exceeds_the_threshold(seen, threshold, rate) -> None:
    table, rule, over, plain = empty_table(*SHAPE), _eq_2(threshold, rate), 0, np.zeros(SHAPE)
    for state, action, sample in seen:
        over += update(table, rule, state, action, sample)
        plain[state, action] += rate * (sample - plain[state, action])
        assert (over > 0) == (np.abs(table.delta).max() > threshold)
        assert over == np.count_nonzero(np.abs(table.delta) > threshold)
    assert (table.delta == plain).all()
    assert table.visits.sum() == len(seen)


def _significant(history: list[float], rule: DeltaRule) -> float:
    """|mean| - z se - threshold from the samples themselves; positive iff the pair is over the threshold."""
    if len(history) < rule.min_visits:
        return -1.0
    se = max(float(np.std(history)), rule.sd_floor) / math.sqrt(len(history))
    return abs(float(np.mean(history))) - rule.z * se - rule.threshold


@settings(deadline=None)
@given(samples, st.floats(0, 5), st.floats(0, 4), st.integers(2, 8))
def test_the_confidence_gate_counts_the_pairs_whose_mean_is_significant(seen, threshold, z, min_visits) -> None:
    rule, table, over = _confident(threshold, z, min_visits), empty_table(*SHAPE), 0
    histories: dict[tuple[int, int], list[float]] = defaultdict(list)
    for state, action, sample in seen:
        over += update(table, rule, state, action, sample)
        history = histories[state, action]
        history.append(sample)
        margin = _significant(history, rule)
        assert over == np.count_nonzero(table.over)
        assert abs(margin) < 1e-9 or table.over[state, action] == (margin > 0)
        assert table.delta[state, action] == pytest.approx(np.mean(history), abs=1e-9)


def test_the_confidence_gate_closes_on_a_significant_mean_and_not_on_noise() -> None:
    rng = np.random.default_rng(0)
    noise, shifted = rng.normal(0, 4, 2000).tolist(), rng.normal(2, 4, 2000).tolist()
    assert not any(_feed(_confident(), noise)[1])
    assert _feed(_confident(), shifted)[1][-1]
    assert any(_feed(_eq_2(1.0, 0.05), noise)[1])  # Algorithm 1's own gate does close on that noise


def test_the_confidence_gate_waits_for_its_visits_and_distrusts_equal_samples() -> None:
    assert _feed(_confident(), [50.0] * 6)[1] == [False] * 4 + [True] * 2
    # 1.2 - 3 * .3 / sqrt(n) > 1 only from n = 21 on, however little the samples differ
    assert _feed(_confident(), [1.2] * 30)[1] == [False] * 20 + [True] * 10


def test_the_gate_opens_again_when_delta_comes_back() -> None:
    assert _feed(_eq_2(4.0), [10.0, 0.0, 10.0, 10.0])[1] == [True, False, True, True]


def test_a_delta_at_the_threshold_does_not_exceed_it() -> None:
    assert _feed(_eq_2(5.0), [10.0])[1] == [False]
    assert _feed(_eq_2(5.0), [-10.0])[1] == [False]
    assert _feed(_eq_2(4.999), [-10.0])[1] == [True]
