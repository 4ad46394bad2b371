"""The evaluation curve as columns, its digest, and what is read off it."""

from __future__ import annotations

import json
import math

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from trainables import curve
from trainables.curve import EvalPoint

finite = st.floats(allow_nan=False, allow_infinity=False)
POINTS = [
    EvalPoint(0, 0, -200.0, -86.6, None, {"psi": 1.0}, seconds=0.5),
    EvalPoint(10, 1900, -100.0, -60.0, -190.0, {"psi": 0.9, "late": 2.0}, seconds=1.5),
]


def test_columns_have_one_entry_per_point_and_none_where_a_point_lacks_the_value() -> None:
    table = curve.columns(POINTS)
    assert table["episode"] == [0, 10]
    assert table["training_return"] == [None, -190.0]
    assert table["late"] == [None, 2.0]
    assert {len(values) for values in table.values()} == {2}
    assert set(table) == {*curve.FIELDS, "psi", "late"}


def test_no_points_give_empty_columns() -> None:
    assert curve.columns([]) == {field: [] for field in curve.FIELDS}


@settings(deadline=None)
@given(st.sampled_from(["greedy_return", "discounted_return", "psi", "episode", "late"]), st.integers(0, 1))
def test_the_digest_sees_the_last_bit_of_everything_but_the_seconds(column: str, row: int) -> None:
    table = curve.columns(POINTS)
    digest = curve.digest(table)
    assert curve.digest(table | {"seconds": [7.0, 8.0]}) == digest
    values = list(table[column])
    value = values[row]
    values[row] = 0.0 if value is None else value + 1 if isinstance(value, int) else math.nextafter(value, math.inf)
    assert curve.digest(table | {column: values}) != digest


def test_the_digest_survives_json_and_sees_a_column_more_or_less() -> None:
    table = curve.columns(POINTS)
    assert curve.digest(json.loads(json.dumps(table))) == curve.digest(table)
    assert curve.digest({key: values for key, values in table.items() if key != "psi"}) != curve.digest(table)


@pytest.mark.parametrize("value", [math.nan, math.inf])
def test_a_curve_with_a_value_that_is_no_number_has_no_digest(value: float) -> None:
    with pytest.raises(ValueError, match="JSON"):
        curve.digest({"greedy_return": [value]})


@settings(deadline=None)
@given(st.lists(st.floats(-1e6, 1e6), min_size=1))
def test_auc_is_the_mean_of_the_curve(values: list[float]) -> None:
    assert curve.auc(values) == pytest.approx(math.fsum(values) / len(values), abs=1e-6)


def test_a_nan_in_the_curve_is_not_averaged_away() -> None:
    assert math.isnan(curve.auc([1.0, math.nan, 2.0]))
    assert math.isnan(curve.asymptotic([1.0] * 30 + [math.nan]))


def test_asymptotic_performance_is_the_mean_of_the_last_tenth() -> None:
    assert curve.asymptotic([0.0] * 45 + [1.0, 2.0, 3.0, 4.0, 5.0]) == 3.0
    assert curve.asymptotic([0.0, 7.0]) == 7.0
