"""The page of the reproduction says what the published cells say."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import stats

from benchmarks.reproduction.__main__ import page
from benchmarks.reproduction.claims import CLAIMS, DELTA_ES, DQN, ES, X5, Arm, Claim, Comparison
from benchmarks.reproduction.curves import Curves
from benchmarks.reproduction.verdicts import findings, holm
from orchestrator.dataset.dataset import Dataset
from trainables.cell import Cell, Source
from trainables.tasks.registry import parse_task

PUBLISHED = Path(__file__).parents[2] / "docs" / "dataset"


def test_holm_is_the_textbook_example() -> None:
    assert holm([0.01, 0.04, 0.03, 0.005]) == pytest.approx([0.03, 0.06, 0.06, 0.02])


@given(st.lists(st.floats(0, 1), min_size=1, max_size=20))
def test_holm_lies_between_the_plain_p_and_bonferronis(p_values: list[float]) -> None:
    for plain, corrected in zip(p_values, holm(p_values), strict=True):
        assert plain <= corrected <= min(1.0, plain * len(p_values)) + 1e-12
    order = np.argsort(p_values, kind="stable")
    assert (np.diff(np.asarray(holm(p_values))[order]) >= 0).all()


class _Drawn(Curves):
    """AUCs by agent on one target, drawn by the test."""

    def __init__(self, aucs: dict[str, list[float]]) -> None:
        self._aucs = aucs

    def best(self, target: str, arm: Arm) -> pd.DataFrame:
        values = self._aucs.get(arm.agent, []) if target == X5 else []
        return pd.DataFrame({"auc": values, "first_tenth": values}, index=pd.RangeIndex(len(values)))


def _verdicts(aucs: dict[str, list[float]], *parts: Comparison) -> list[str]:
    return [finding.verdict for _, found in findings(_Drawn(aucs), [Claim("x", "", "", parts)]) for finding in found]


def test_a_verdict_is_that_of_the_corrected_test() -> None:
    noise = np.random.default_rng(0).normal(0, 1, (3, 10))
    aucs = {"dqn": list(100 + noise[0]), "es": list(110 + noise[1]), "delta_es": list(100.2 + noise[2])}
    found = _verdicts(aucs, Comparison(X5, ES, DQN), Comparison(X5, DQN, ES), Comparison(X5, DELTA_ES, DQN))
    assert found == ["confirmed", "contradicted", "undecided"]
    assert _verdicts(aucs, Comparison(X5, DELTA_ES, DQN, "no worse")) == ["confirmed"]
    assert _verdicts(aucs, Comparison(X5, DELTA_ES, ES, "no worse")) == ["contradicted before correction"]
    assert _verdicts({"dqn": [1.0]}, Comparison(X5, ES, DQN)) == ["not run"]


def test_the_correction_can_take_a_claim_back() -> None:
    draws = np.random.default_rng(1).normal(0, 1, (2, 12))
    aucs = {"dqn": list(draws[0]), "es": list(draws[1] + 1.0)}
    part = Comparison(X5, ES, DQN)
    p = stats.ttest_rel(aucs["es"], aucs["dqn"]).pvalue
    assert 0.05 / 3 < p < 0.05
    assert _verdicts(aucs, part) == ["confirmed"]
    others = [Comparison(X5, ES, DQN, column="first_tenth"), Comparison(X5, DQN, ES)]
    assert _verdicts(aucs, part, *others)[0] == "confirmed before correction only"


def test_every_claim_is_of_agents_and_targets_that_there_are() -> None:
    for part in (part for claim in CLAIMS for part in claim.parts):
        task = parse_task(part.target)
        for arm in (part.better, part.worse):
            source = Source(task=task.name, kind="learned", cell_id="0" * 16, steps=None if task.tabular else 1)
            needs = arm.agent not in ("dqn", "q_learning")
            Cell.create(arm.agent, part.target, 0, dict(arm.settings), source if needs else None)


def test_the_page_is_that_of_the_published_dataset() -> None:
    written = (PUBLISHED.parent / "reproduction.md").read_text()
    dataset = Dataset(PUBLISHED)
    assert page(dataset, Curves(dataset)) == written, "run python -m benchmarks.reproduction"
