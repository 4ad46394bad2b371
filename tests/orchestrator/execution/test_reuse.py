"""Cells that another sweep of the storage has finished are copied, never shared."""

from __future__ import annotations

import io
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from conftest import CELLS, LOCAL, SPACE, record_lines, set_record_lines
from rich.console import Console

from orchestrator.execution.forecast import forecast
from orchestrator.execution.settings import LIBRARY, RunSummary, Settings
from orchestrator.execution.sweep import run
from orchestrator.results import other_sweeps
from orchestrator.results.admin import remove
from orchestrator.results.sweep_folder import Results
from search_spaces.loading import parse
from search_spaces.search_space import SearchSpace
from trainables.plugins.loader import pin

ALL = replace(LOCAL, reuse="all")
FIRST = parse("small", SPACE)
SOURCES, TRANSFERS = 4, CELLS - 4


@pytest.fixture
def storage(tmp_path: Path) -> Path:
    ran(tmp_path, "first", FIRST)
    return tmp_path


def ran(
    storage: Path, name: str, space: SearchSpace, settings: Settings = ALL, console: Console | None = None
) -> RunSummary:
    return run(Results.create(storage, name, space), settings, console or Console(quiet=True))


def grown(**changes: Any) -> SearchSpace:
    return parse("small", SPACE | changes)


def test_only_what_no_other_sweep_has_finished_runs_and_it_is_said(storage: Path) -> None:
    said = io.StringIO()
    more = grown(seeds=3)
    expected = forecast(more, ALL, Results(storage / "second"), workers=1)
    assert [stage.taken for stage in expected.stages] == [{LIBRARY: SOURCES}, {"first": TRANSFERS}]
    assert [stage.cells - stage.done for stage in expected.stages] == [SOURCES // 2, TRANSFERS // 2]
    tally = ran(storage, "second", more, console=Console(file=said, width=160))
    assert (tally.ran, tally.reused) == (CELLS // 2, CELLS)
    assert tally.taken == {LIBRARY: SOURCES, "first": TRANSFERS}
    assert f"transfer: {TRANSFERS} taken from the sweep first" in said.getvalue()


def test_a_copied_record_is_the_same_and_outlives_the_sweep_that_trained_it(storage: Path) -> None:
    ran(storage, "second", FIRST)
    first, second = (Results.open(storage, name) for name in ("first", "second"))
    assert dict(first.heads()) == dict(second.heads())
    assert sorted(record_lines(first)) == sorted(record_lines(second))
    remove(first)
    again = Results.open(storage, "second")
    assert run(again, ALL, Console(quiet=True)).ran == 0
    assert len(again.tables()[0]) == CELLS
    assert ran(storage, "third", FIRST).taken == {LIBRARY: SOURCES, "second": TRANSFERS}


@pytest.mark.parametrize(("reuse", "ran_anew"), [("none", CELLS), ("sources", TRANSFERS)])
def test_less_is_taken_on_wish(storage: Path, reuse: Any, ran_anew: int) -> None:
    assert ran(storage, "second", FIRST, replace(LOCAL, reuse=reuse)).ran == ran_anew
    first, second = (Results.open(storage, name).heads() for name in ("first", "second"))
    assert {key: head.digest for key, head in first.items()} == {key: head.digest for key, head in second.items()}


def test_a_confirmation_that_another_sweep_has_run_is_copied_too(tmp_path: Path) -> None:
    confirmed = grown(confirm={"seeds": 2})
    before = ran(tmp_path, "first", confirmed)
    again = ran(tmp_path, "second", confirmed)
    assert (again.ran, again.reused, sum(again.taken.values())) == (0, before.ran, before.ran)


def test_what_a_search_suggests_again_is_copied_and_counted_in_the_tables(tmp_path: Path) -> None:
    ranges = {"learning_rate": {"low": 0.05, "high": 0.5}}
    source = {"task": "windy_gridworld", "hyperparameters": ranges}
    searching = grown(
        scenarios=[{"source": source, "targets": ["windy_gridworld:wind=small"]}],
        agents={"q_learning": {}, "delta_gate": {"threshold": {"low": 1.0, "high": 12.0}}},
        search={"method": "optuna", "budget": 3},
    )
    before = ran(tmp_path, "first", searching)
    again = ran(tmp_path, "second", searching)
    assert again.ran == 0
    first, second = (Results.open(tmp_path, name) for name in ("first", "second"))
    assert sorted(first.tables()[0]["cell_id"]) == sorted(second.tables()[0]["cell_id"])
    assert len(second.tables()[0]) == before.ran


def test_failed_damaged_and_other_versions_records_are_not_taken(
    storage: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    first = Results.open(storage, "first")
    lines = record_lines(first)
    transfers = [line for line in lines if b'"sources"' in line or b"wind=" in line.split(b"\t")[2]]
    damaged = [line[:-20] + b"x" * 19 + b"\n" if line == transfers[0] else line for line in lines]
    set_record_lines(first, damaged)
    assert ran(storage, "second", FIRST).ran == 1
    remove(Results.open(storage, "second"))
    monkeypatch.setattr(other_sweeps, "versions", lambda: {"numpy": "0.1"})
    assert ran(storage, "third", FIRST).ran == TRANSFERS


def test_cells_of_custom_code_are_trained_in_each_sweep(tmp_path: Path) -> None:
    tank = Path(__file__).parents[3] / "docs" / "examples" / "tank.py"
    task = pin(f"{tank}:Task")
    space = grown(
        scenarios=[{"source": {"task": task, "agent": "dqn"}, "targets": [f"{task}:leak=2x"]}],
        agents={"dqn": {}},
        seeds=1,
        hyperparameters={"episodes": [3]},
    )
    ran(tmp_path, "first", space)
    second = ran(tmp_path, "second", space)
    assert (second.ran, second.taken) == (1, {LIBRARY: 1})
