"""The verdict: the surest case of either direction comes first, and a loss of a configuration that is not the best."""

from __future__ import annotations

from pathlib import Path

import pytest

from dashboards.report.sections import winners
from dashboards.report.verdict import sureness, verdict
from orchestrator.analysis.findings import Findings, find
from tests.dashboards import synthetic

GRIDS = {
    "q_learning": [{}],
    "policy_reuse": [{}],
    "delta_gate": [{"threshold": 10.0}, {"threshold": 3.0}],
}
AUC = {
    ("q_learning", None): -40.0,
    ("policy_reuse", None): -30.0,
    ("delta_gate", 10.0): -200.0,
    ("delta_gate", 3.0): -40.0,
}


@pytest.fixture
def told(tmp_path: Path) -> Findings:
    """A sweep in which one threshold loses five times the return and the other nothing."""
    made = synthetic.findings(tmp_path, 1, 4, 5, GRIDS)
    cells = made.cells.copy()
    for at, row in cells.iterrows():
        threshold = synthetic.json.loads(row["hyperparameters"]).get("threshold")
        noise = 0.1 * (row["seed"] % 2) * (1 if threshold == 3.0 else -1)
        cells.loc[at, "auc"] = AUC[row["agent"], threshold] + noise
    return find(made.results, (cells, made.points))


def test_the_surest_direction_comes_first_whichever_it_is(told: Findings) -> None:
    said = verdict(told, winners(told))
    assert [direction.verdict for direction in said.directions] == ["hurt", "helped"]
    assert (said.helped, said.hurt) == (1, 0)
    assert said.cells == "4 seeds; all 16 cells are done"


def test_a_loss_of_another_configuration_is_told_with_the_best_ones_effect(told: Findings) -> None:
    loss = verdict(told, winners(told)).directions[0].headlines[0]
    assert loss.what == "delta_gate (threshold=10), exact source"
    assert loss.effect.startswith("−4")
    assert "in place of −40" in loss.evidence
    assert loss.remark.startswith("its best configuration is delta_gate (threshold=3)")


def test_a_gain_is_told_of_best_configurations_alone(told: Findings) -> None:
    gains = verdict(told, winners(told)).directions[1].headlines
    assert [line.agent for line in gains] == ["policy_reuse"]
    assert gains[0].remark == ""


def test_an_agent_without_comparison_is_sure_of_nothing(told: Findings) -> None:
    assert [sureness(group) for group in told.groups if group.source == "none"] == [0.0]
