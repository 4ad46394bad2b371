"""Results in words."""

from __future__ import annotations

from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from orchestrator.analysis.findings import find
from orchestrator.analysis.labels import cell_name, group_name, settings, settings_text, shared
from orchestrator.analysis.metrics import DIFFERENCE, TRANSFER_RATIO
from orchestrator.analysis.statistics import Estimate, TransferRatio
from orchestrator.results.sweep_folder import Results
from trainables.cell import Cell


@pytest.mark.parametrize(
    ("ratio", "text"),
    [
        (TransferRatio(0.281, 0.24, 0.32), "+28% [+24, +32]"),
        (TransferRatio(-0.004, -0.02, 0.001), "-0.4% [-2, +0.1]"),
        (TransferRatio(1.3e-12, 0.0, -1.3e-12), "+0% [+0, +0]"),
        (TransferRatio(-0.5, None, None), "-50%"),
        (TransferRatio(None, None, None, "the interval of the AUC without transfer touches 0"), "undefined"),
    ],
)
def test_a_ratio_in_words(ratio: TransferRatio, text: str) -> None:
    assert TRANSFER_RATIO.text(ratio) == text


def test_a_difference_keeps_its_sign_unless_it_is_nothing() -> None:
    assert DIFFERENCE.text(Estimate(-0.01, -0.02, 0.01)) == "-0.01 [-0.02, +0.01]"
    assert DIFFERENCE.text(Estimate(-1e-12, -2e-12, 0.0)) == "+0.0 [+0.0, +0.0]"
    assert DIFFERENCE.text(Estimate(-3.46, None, None)) == "-3.5"


@given(st.floats(-1e6, 1e6))
def test_a_number_in_words_is_the_number_rounded(value: float) -> None:
    shown = float(DIFFERENCE.text(Estimate(value, None, None)))
    assert shown == round(value, 1 if round(value, 1) else 2)


def test_a_runs_name_has_no_character_that_mlflow_refuses() -> None:
    cell = Cell.create("q_learning", "windy_gridworld:start=[1,2],wind=reversed", 3)
    assert cell_name(cell) == "q_learning / windy_gridworld wind reversed,start (1,2) / seed 3"
    assert settings_text({}) == "-"


def test_what_was_tuned_is_shown_also_where_it_equals_the_default(finished: Path) -> None:
    findings = find(Results.open(finished, "small"))
    sources = [group for group in findings.groups if group.stage == "source"]
    assert sorted(settings(group)["learning_rate"] for group in sources) == [0.1, 0.5]
    assert {group.tuned for group in sources} == {frozenset({"learning_rate"})}
    gate = next(group for group in findings.groups if group.agent == "delta_gate")
    assert "learning_rate" not in settings(gate)
    assert all("learning_rate 0." in group_name(group) for group in sources)
    assert "learning_rate" not in shared(sources[:1] * 2), "it stands beside 'best of 2'"
