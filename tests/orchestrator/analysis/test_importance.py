"""Importance: the hyperparameter that moves the AUC gets the variance; few draws and grids have none."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from dashboards.figure_model import Absent, Chart
from dashboards.figures import importance as figure
from orchestrator.analysis.findings import Findings, find
from orchestrator.analysis.importance import MIN_CONFIGURATIONS, importances
from tests.dashboards import synthetic

SPACE: dict[str, Any] = {
    "agents": {
        "q_learning": {},
        "ppr": {"nu": {"low": 0.5, "high": 1.0}, "learning_rate": {"low": 0.01, "high": 1.0, "log": True}},
    },
    "search": {"method": "random", "budget": 30},
}

NAMES = ("nu", "learning_rate")


def sweep(folder: Path, draws: int, space: dict[str, Any] = SPACE, names: tuple[str, ...] = NAMES) -> Findings:
    """A sweep whose AUC is that of `nu` alone, with noise."""
    rng = np.random.default_rng(1)
    values = [{"nu": rng.uniform(0.5, 1), "learning_rate": 10 ** rng.uniform(-2, 0)} for _ in range(draws)]
    values = [{name: each[name] for name in names} for each in values]
    made = synthetic.findings(folder, 1, 2, 5, {"q_learning": [{}], "ppr": values}, **space)
    cells = made.cells.copy()
    for at, row in cells.iterrows():
        nu = synthetic.json.loads(row["hyperparameters"]).get("nu", 0.5)
        cells.loc[at, "auc"] = 100 * nu + rng.normal()
    return find(made.results, (cells, made.points))


@pytest.fixture(scope="module")
def findings(tmp_path_factory: pytest.TempPathFactory) -> Findings:
    """Of a search by 30 draws."""
    return sweep(tmp_path_factory.mktemp("draws"), 30)


def test_what_moves_the_auc_has_the_variance_and_the_same_results_give_the_same_shares(findings: Findings) -> None:
    (found,) = importances(findings)
    assert (found.key.agent, found.configurations) == ("ppr", 30)
    assert list(found.shares) == ["nu", "learning_rate"]
    assert found.shares["nu"] > 0.9
    assert sum(found.shares.values()) == pytest.approx(1)
    assert importances(findings) == [found]


def test_the_figure_has_a_bar_per_hyperparameter(findings: Findings) -> None:
    drawn = figure.chart(findings)
    assert isinstance(drawn, Chart)
    (panel,) = drawn.panels
    assert panel.x_ticks == ("nu", "learning_rate")
    assert sum(y or 0 for y in panel.series[0].y) == pytest.approx(100)


def test_the_share_of_a_single_hyperparameter_is_not_shown(tmp_path: Path) -> None:
    assert importances(sweep(tmp_path, 30, names=("nu",))) == []


def test_few_draws_and_grids_have_none(tmp_path: Path) -> None:
    assert importances(sweep(tmp_path / "few", MIN_CONFIGURATIONS - 1)) == []
    grids = {"agents": {"q_learning": {}, "ppr": {"nu": [0.5, 0.7]}}}
    findings = sweep(tmp_path / "grid", 30, grids)
    assert importances(findings) == []
    assert isinstance(figure.chart(findings), Absent)


def test_equal_aucs_have_none(findings: Findings) -> None:
    flat = findings.cells.assign(auc=-1.0)
    assert importances(find(findings.results, (flat, findings.points))) == []
