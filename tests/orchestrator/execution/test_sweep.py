"""A sweep runs every cell once, survives failures, grows, and gives the bits of a plain run."""

from __future__ import annotations

import copy
import io
import json
import shutil
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
import yaml
from conftest import CELLS, LOCAL, SPACE, record_lines, set_record_lines, timeless
from rich.console import Console

from orchestrator.analysis.findings import find
from orchestrator.cluster import connection
from orchestrator.execution.cells.ledger import Ledger
from orchestrator.execution.replay import replay
from orchestrator.execution.settings import RunSummary, Settings
from orchestrator.execution.sweep import run
from orchestrator.export.best_params import read_params, write_best
from orchestrator.results.status import sweep_status
from orchestrator.results.sweep_folder import Results
from search_spaces.loading import parse
from trainables.cell import Cell
from trainables.errors import InputError
from trainables.knowledge import Knowledge
from trainables.training.cell_run import run_cell

QUIET = Console(quiet=True)


def sweep(storage: Path, settings: Settings | None = None, **changes: Any) -> tuple[Results, RunSummary]:
    space = copy.deepcopy(SPACE) | changes
    results = Results.create(storage, "small", parse("small", space))
    return results, run(results, settings or LOCAL, QUIET)


@pytest.fixture
def storage(finished: Path, tmp_path: Path) -> Path:
    shutil.copytree(finished, tmp_path / "storage")
    return tmp_path / "storage"


def test_a_finished_sweep_runs_nothing_again_and_starts_no_ray(storage: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(connection, "connected", None)
    _, tally = sweep(storage, Settings())
    assert (tally.ran, tally.reused) == (0, CELLS)


def test_only_missing_cells_run_and_the_tables_are_the_same(storage: Path) -> None:
    results = Results.open(storage, "small")
    before, points = (timeless(table) for table in results.write_tables())
    lines = record_lines(results)
    missing = len(lines[::5])
    set_record_lines(results, (line for number, line in enumerate(lines) if number % 5))
    for line in lines[::5]:  # the library would give the records of sources back
        (storage / "sources" / f"{line.split(bytes([9]))[1].decode()}.npz").unlink(missing_ok=True)
    _, tally = sweep(storage)
    assert (tally.ran, tally.reused) == (missing, CELLS - missing)
    after, again = (timeless(table) for table in results.write_tables())
    assert after.equals(before)
    assert again.equals(points)


def test_a_grown_space_runs_only_its_new_cells(storage: Path) -> None:
    _, tally = sweep(storage, seeds=3)
    assert (tally.ran, tally.reused) == (CELLS // 2, CELLS)
    _, tally = sweep(storage, seeds=3, agents={**SPACE["agents"], "q_warm_start": {}})  # type: ignore[dict-item]
    assert (tally.ran, tally.reused) == (12, CELLS // 2 * 3)


def test_a_shrunk_space_leaves_the_other_cells_alone_and_out_of_the_tables(storage: Path) -> None:
    results, tally = sweep(storage, agents={"q_learning": {}})
    assert tally.ran == 0
    cells, _ = results.write_tables()
    assert len(cells) == 8
    assert len(results.heads()) == CELLS


def test_a_source_that_is_lost_from_the_library_is_trained_again_where_a_missing_cell_needs_it(
    storage: Path, tmp_path: Path
) -> None:
    shutil.copytree(storage, tmp_path / "whole")
    for path in (storage / "sources").glob("*.npz"):
        path.unlink()
    said = Console(record=True, file=io.StringIO())
    results = Results.open(storage, "small")
    assert run(results, LOCAL, said).ran == 0
    assert "no missing cell needs what 4 recorded sources learned" in said.export_text()
    more = {**SPACE["agents"], "q_warm_start": {}}  # type: ignore[dict-item]
    results, tally = sweep(storage, agents=more)
    assert tally.ran == 2 + 8, "one learning rate is chosen, whose two seeds advise"
    assert len(list((storage / "sources").glob("*.npz"))) == 2
    whole, _ = sweep(tmp_path / "whole", agents=more)
    assert all(timeless(a).equals(timeless(b)) for a, b in zip(results.tables(), whole.tables(), strict=True))
    _, tally = sweep(storage, replace(LOCAL, reuse="none"), agents=more)
    assert (tally.ran, len(list((storage / "sources").glob("*.npz")))) == (2, 4)


def test_networks_that_are_ranked_are_all_trained_again(tmp_path: Path) -> None:
    scenario = {
        "source": {"task": "cartpole", "agent": "dqn", "seeds": 2, "pick": "ranked"},
        "targets": ["cartpole:gravity=5x"],
    }
    tiny = {"episodes": [4], "evaluate_every": [2], "evaluation_episodes": [1], "hidden_size": [8], "batch_size": [8]}
    changes = {"scenarios": [scenario], "agents": {"es": {}}, "hyperparameters": tiny, "seeds": 1}
    sweep(tmp_path, **changes)
    for path in (tmp_path / "sources").glob("*.npz"):
        path.unlink()
    assert sweep(tmp_path, **changes)[1].ran == 2


def test_a_sweep_gives_the_bits_of_a_plain_run(storage: Path) -> None:
    results = Results.open(storage, "small")
    cells, _ = results.tables()
    for cell_id in cells.drop_duplicates(["agent", "source"])["cell_id"]:
        found = replay(storage, cell_id)
        assert found.agrees, found


def test_replay_says_where_a_curve_differs(storage: Path) -> None:
    results = Results.open(storage, "small")
    cell_id = next(iter(results.heads()))
    record = results.record(cell_id)
    assert record is not None
    points = copy.deepcopy(record.points)
    points["greedy_return"][2] = -1.25
    from trainables import curve

    results.add(record.model_copy(update={"points": points, "digest": curve.digest(points)}))
    found = replay(storage, cell_id)
    assert not found.agrees
    assert found.first_difference is not None
    assert found.first_difference.startswith("greedy_return at episode 20: -1.25 was recorded")


def test_a_record_from_before_a_statistic_was_reported_is_replayed_by_what_it_has(storage: Path) -> None:
    results = Results.open(storage, "small")
    record = next(r for _, _, r in results.records() if r is not None and r.cell.agent == "delta_gate")
    points = {name: column for name, column in record.points.items() if name != "max_abs_delta"}
    assert len(points) == len(record.points) - 1
    from trainables import curve

    results.add(record.model_copy(update={"points": points, "digest": curve.digest(points)}))
    assert replay(storage, record.cell.id).agrees


def test_a_failed_cell_is_kept_as_failed_until_it_is_asked_for_again(
    storage: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    results = Results.open(storage, "small")
    record = next(r for _, _, r in results.records() if r is not None and r.cell.agent == "delta_gate")
    results.add(record.model_copy(update={"status": "failed", "error": "ZeroDivisionError: test"}))
    _, tally = sweep(storage)
    assert tally.ran == 0
    status = sweep_status(results)
    assert status["stages"]["transfer"]["failed"] == 1
    assert status["failures"][0]["error"] == "ZeroDivisionError: test"
    _, tally = sweep(storage, replace(LOCAL, retry_failed=True))
    assert (tally.ran, tally.failed) == (1, 0)


def test_a_cell_that_raises_is_reported_with_its_place_and_the_next_one_runs() -> None:
    good = Cell.create("q_learning", "windy_gridworld", 0, {"episodes": 10})
    bad = {
        "seed": 0,
        "agent": "delta_gate",
        "source": {"task": "windy_gridworld", "kind": "learned", "cell_id": "0" * 16},
    }
    cell = Cell.from_json(json.loads(json.dumps(good.to_json())) | bad | {"hyperparameters": {"episodes": 10}})
    result = run_cell(cell, lambda cell: Knowledge({}))
    assert result is not None
    assert result.status == "failed"
    assert result.error.startswith("InputError: the source is not a Q table")
    assert "knowledge.py:" in result.error
    next_one = run_cell(good, lambda cell: None, keep=True)
    assert next_one is not None
    assert next_one.status == "done"


def test_an_outcome_that_is_told_twice_counts_once(tmp_path: Path) -> None:
    results = Results.create(tmp_path, "small", parse("small", SPACE))
    ledger = Ledger(results, retry_failed=False)
    cell = Cell.create("q_learning", "windy_gridworld", 0, {"episodes": 10})
    ledger.plan("source", [cell])
    outcome = run_cell(cell, lambda cell: None)
    assert outcome is not None
    assert [record.cell for record in ledger.take("source", [outcome])] == [cell]
    assert ledger.take("source", [outcome]) == []
    assert len(record_lines(results)) == 1


def test_two_drivers_at_one_sweep_are_refused_and_a_dead_ones_lock_is_free(storage: Path) -> None:
    code = f"""
import time
from pathlib import Path
from orchestrator.results.lock import locked
with locked(Path({str(storage / "small")!r})):
    print("locked", flush=True)
    time.sleep(60)
"""
    with subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE, text=True) as other:
        assert other.stdout is not None
        assert other.stdout.readline() == "locked\n"
        with pytest.raises(InputError, match=f"is being run by process {other.pid} on "):
            sweep(storage)
        assert f"process {other.pid}" in str(sweep_status(Results.open(storage, "small"))["driver"])
        other.kill()
    _, tally = sweep(storage)
    assert tally.reused == CELLS


def test_exported_hyperparameters_come_back_as_the_next_sweeps(storage: Path, tmp_path: Path) -> None:
    data = write_best(find(Results.open(storage, "small")), tmp_path / "best.yaml")
    assert yaml.safe_load((tmp_path / "best.yaml").read_text()) == data
    assert {"task", "agent", "source", "hyperparameters", "auc", "transfer_ratio", "seeds", "ties"} <= set(
        data["best"][0]
    )
    params = read_params(tmp_path / "best.yaml")
    results = Results.create(tmp_path / "next", "small", parse("small", SPACE))
    run(results, replace(LOCAL, params=params), QUIET)
    cells, _ = results.write_tables()
    assert len(cells) == 2 + 2 * (2 + 4 + 4)
    values = {(key.task, key.agent, key.kind): values for key, values in params.items()}
    for key, frame in cells.groupby(["task", "agent", "source"]):
        assert {json.dumps(values[key], sort_keys=True)} == set(frame["hyperparameters"])


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("[1, 2]", "not a file of best hyperparameters"),
        ("schema: 1\nbest: [{task: windy_gridworld}]", "best.0 lacks"),
        ("schema: 1\nbest: [{task: windy, agent: ppr, source: none, hyperparameters: {}}]", "unknown task 'windy'"),
        ("schema: 1\nbest: [{task: windy_gridworld, agent: ppr, source: x, hyperparameters: {nu: 7}}]", "nu must be"),
    ],
)
def test_a_file_that_is_no_export_is_refused(tmp_path: Path, text: str, says: str) -> None:
    (tmp_path / "best.yaml").write_text(text)
    with pytest.raises(InputError, match=says):
        read_params(tmp_path / "best.yaml")


@pytest.mark.parametrize("method", ["random", "optuna"])
def test_a_search_spends_its_budget_and_a_second_run_of_it_nothing(tmp_path: Path, method: str) -> None:
    agents = {"delta_gate": {"threshold": {"low": 1.0, "high": 12.0}}, "q_learning": {}}
    scenario = copy.deepcopy(SPACE["scenarios"][0]) | {"targets": ["windy_gridworld:wind=reversed"]}  # type: ignore[index]
    changes = {"agents": agents, "scenarios": [scenario], "search": {"method": method, "budget": 4}}
    results, tally = sweep(tmp_path, **changes)
    cells, _ = results.write_tables()
    searched = cells[cells["agent"] == "delta_gate"]
    thresholds = {json.loads(text)["threshold"] for text in searched["hyperparameters"]}
    assert len(thresholds) == 2 * 4
    assert all(1.0 <= threshold <= 12.0 for threshold in thresholds)
    assert tally.ran == 4 + 2 + 2 * 4 * 2
    results, tally = sweep(tmp_path, **changes)
    assert (tally.ran, tally.reused) == (0, len(cells))
    assert len(results.write_tables()[0]) == len(cells)
