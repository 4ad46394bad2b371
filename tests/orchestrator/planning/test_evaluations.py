"""An AUC of few evaluations is warned of."""

from __future__ import annotations

from orchestrator.planning.evaluations import few_evaluations


def test_two_evaluations_of_an_auc_are_warned_of() -> None:
    text = few_evaluations({"episodes": 50, "evaluate_every": 100})
    assert text is not None
    assert "leaves 2 evaluations" in text
    assert few_evaluations({"episodes": 1000, "evaluate_every": 100}) is None
    assert few_evaluations({}) is None
