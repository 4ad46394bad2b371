"""Results in words."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from orchestrator.describe import cell_name, estimate_text, ratio_text, settings_text
from orchestrator.statistics import Estimate, TransferRatio
from trainables.cell import Cell


@pytest.mark.parametrize(
    ("ratio", "text"),
    [
        (TransferRatio(0.281, 0.24, 0.32), "+28% [+24, +32]"),
        (TransferRatio(-0.001, -0.002, 0.001), "+0% [+0, +0]"),
        (TransferRatio(-0.5, None, None), "-50%"),
        (TransferRatio(None, None, None, "the interval of the AUC without transfer touches 0"), "undefined"),
    ],
)
def test_a_ratio_in_words(ratio: TransferRatio, text: str) -> None:
    assert ratio_text(ratio) == text


def test_a_difference_that_rounds_to_nothing_has_no_minus() -> None:
    assert estimate_text(Estimate(-0.01, -0.02, 0.01)) == "+0.0 [+0.0, +0.0]"
    assert estimate_text(Estimate(-3.46, None, None)) == "-3.5"


@given(st.floats(-1e6, 1e6))
def test_a_number_in_words_is_the_number_rounded(value: float) -> None:
    assert float(estimate_text(Estimate(value, None, None))) == round(value, 1)


def test_a_runs_name_has_no_character_that_mlflow_refuses() -> None:
    cell = Cell.create("q_learning", "windy_gridworld:start=[1,2],wind=reversed", 3)
    assert cell_name(cell) == "q_learning / windy_gridworld wind reversed,start (1,2) / seed 3"
    assert settings_text({}) == "-"
