"""Two sources of one target, and two picks of one source: each is selected, compared, named and exported by itself."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import pandas as pd
import pytest

from dashboards.figure_model import Matrix
from dashboards.figures import transfer_matrix
from dashboards.labels import by_source, heading, label
from orchestrator.analysis.findings import Findings, find
from orchestrator.analysis.tables.summary_table import row
from orchestrator.export.best_params import best, read_params, write_best
from orchestrator.planning.arms import Key, Label
from orchestrator.results.sweep_folder import Results
from orchestrator.results.tables.cell_row import cell_row
from orchestrator.tracking.mlflow.fields import group_figures
from search_spaces.loading import parse
from trainables.cell import Cell, Source

ORIGIN, SMALL, REVERSED = "windy_gridworld", "windy_gridworld:wind=small", "windy_gridworld:wind=reversed"
OWN, BEST = "own_seed", "best_evaluated"
SPACE = {
    "schema": 1,
    "name": "two",
    "seeds": 2,
    "scenarios": [{"source": {"task": source}, "targets": [REVERSED]} for source in (ORIGIN, SMALL)],
    "agents": {"q_learning": {}, "delta_gate": {}},
}


def rows(cells: Sequence[Cell], aucs: Sequence[float], label: Label) -> list[dict[str, object]]:
    """The rows of cells that are done, with these AUCs."""
    figures = ("auc", "training_auc", "initial_return", "final_return", "asymptotic")
    return [
        cell_row("transfer", cell, None, label) | {"status": "done"} | dict.fromkeys(figures, auc)
        for cell, auc in zip(cells, aucs, strict=True)
    ]


def gates(source: str, rate: float, checkpoints: str = "ab") -> list[Cell]:
    """delta_gate's cells of two seeds, with the knowledge of the cells that `checkpoints` stand for."""
    learned = [Source(task=source, kind="learned", cell_id=name * 16) for name in checkpoints]
    return [Cell.create("delta_gate", REVERSED, seed, {"learning_rate": rate}, learned[seed]) for seed in (0, 1)]


def bases(rate: float) -> list[Cell]:
    return [Cell.create("q_learning", REVERSED, seed, {"learning_rate": rate}) for seed in (0, 1)]


@pytest.fixture
def findings(tmp_path: Path) -> Findings:
    """Two sources of one target, whose stage 1 has settled other learning rates; the second one by two picks."""
    table = pd.DataFrame(
        [
            *rows(bases(0.5), [-100.0, -102.0], Label(baseline_for=ORIGIN)),
            *rows(bases(0.1), [-50.0, -52.0], Label(baseline_for=SMALL)),
            *rows(gates(ORIGIN, 0.5), [-80.0, -81.0], Label(OWN)),
            *rows(gates(SMALL, 0.1), [-60.0, -61.0], Label(OWN)),
            *rows(gates(SMALL, 0.1, "bb"), [-40.0, -61.0], Label(BEST)),
        ]
    )
    results = Results.create(tmp_path, "two", parse("two", SPACE))
    return find(results, (table, pd.DataFrame({"cell_id": [], "episode": [], "greedy_return": []})))


def test_each_source_and_each_pick_is_compared_with_the_baseline_of_its_own(findings: Findings) -> None:
    compared = {group.key: group.against_base.difference.value for group in findings.best if group.against_base}
    assert compared == {
        Key(REVERSED, "delta_gate", ORIGIN, "learned", OWN): pytest.approx(20.5),
        Key(REVERSED, "delta_gate", SMALL, "learned", OWN): pytest.approx(-9.5),
        Key(REVERSED, "delta_gate", SMALL, "learned", BEST): pytest.approx(0.5),
    }
    assert set(findings.selected) - set(compared) == {
        Key(REVERSED, "q_learning", ORIGIN),
        Key(REVERSED, "q_learning", SMALL),
    }


def test_a_cell_of_two_arms_is_in_both_and_is_counted_once(findings: Findings) -> None:
    # seed 1 has the knowledge of its own source seed by either pick
    assert len(findings.cells) == 10
    assert len(findings.each_cell) == 9
    assert best(findings)["cells"] == {"done": 9}
    assert {group.id: len(group.seeds) for group in findings.groups} == {group.id: 2 for group in findings.groups}


def test_the_names_say_which_source_and_which_pick(findings: Findings) -> None:
    assert [row(group)[2] for group in findings.best] == [
        "none for windy_gridworld",
        f"none for {SMALL}",
        "learned from windy_gridworld",
        f"learned from {SMALL}, own_seed",
        f"learned from {SMALL}, best_evaluated",
    ]
    assert len({label(group) for group in findings.best}) == 5


def test_the_matrix_has_a_row_for_each(findings: Findings) -> None:
    chart = transfer_matrix.chart(findings)
    assert isinstance(chart, Matrix)
    assert chart.rows == (
        (ORIGIN, "learned", "delta_gate"),
        (SMALL, f"learned ({OWN})", "delta_gate"),
        (SMALL, f"learned ({BEST})", "delta_gate"),
    )


def test_best_yaml_has_an_entry_for_each_and_is_read_back(findings: Findings, tmp_path: Path) -> None:
    data = write_best(findings, tmp_path / "best.yaml")
    assert [(entry["source_task"], entry["source"], entry["pick"]) for entry in data["best"]] == [
        (ORIGIN, "none", None),
        (SMALL, "none", None),
        (ORIGIN, "learned", OWN),
        (SMALL, "learned", OWN),
        (SMALL, "learned", BEST),
    ]
    params = read_params(tmp_path / "best.yaml")
    assert set(params) == set(findings.selected)
    assert {key: values["learning_rate"] for key, values in params.items() if key.kind == "none"} == {
        Key(REVERSED, "q_learning", ORIGIN): 0.5,
        Key(REVERSED, "q_learning", SMALL): 0.1,
    }


def test_a_file_of_an_earlier_version_is_read(tmp_path: Path) -> None:
    entry = f"{{task: '{REVERSED}', agent: delta_gate, source: learned, hyperparameters: {{threshold: 3.0}}}}"
    (tmp_path / "old.yaml").write_text(f"schema: 1\nbest: [{entry}]\n")
    assert list(read_params(tmp_path / "old.yaml")) == [Key(REVERSED, "delta_gate", "", "learned")]


def test_each_has_an_aggregate_of_its_own_in_mlflow(findings: Findings) -> None:
    tags = {group.id: group_figures(group)[1] for group in findings.groups}
    assert len(tags) == 5
    assert [(each.get("source_task"), each.get("pick")) for each in tags.values()] == [
        (ORIGIN, None),
        (SMALL, None),
        (ORIGIN, OWN),
        (SMALL, OWN),
        (SMALL, BEST),
    ]


def test_one_source_is_named_by_its_kind_alone(tmp_path: Path) -> None:
    table = pd.DataFrame(
        [*rows(bases(0.5), [-1.0, -2.0], Label()), *rows(gates(ORIGIN, 0.5), [-1.0, -2.0], Label(OWN))]
    )
    found = find(Results.create(tmp_path, "two", parse("two", SPACE)), (table, table))
    assert [group.source_label for group in found.best] == ["none", "learned"]
    assert [group.id for group in found.groups] == [bases(0.5)[0].group, gates(ORIGIN, 0.5)[0].group]


def test_each_source_has_its_curves_beside_its_own_baseline(findings: Findings) -> None:
    shown = {name: [f"{group.agent} {group.source_task}" for group in of] for name, of in by_source(findings.best)}
    assert shown == {
        "learned from windy_gridworld": ["q_learning windy_gridworld", "delta_gate windy_gridworld"],
        f"learned from {SMALL}, own_seed": [f"q_learning {SMALL}", f"delta_gate {SMALL}"],
        f"learned from {SMALL}, best_evaluated": [f"q_learning {SMALL}", f"delta_gate {SMALL}"],
    }
    assert heading(REVERSED, "learned from X, own_seed") == f"{REVERSED}, learned source from X, own_seed"
