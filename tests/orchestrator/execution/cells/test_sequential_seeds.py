"""`seeds: auto`: the sweep runs group after group of seeds, and stops where every comparison is decided."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pandas as pd
import pytest
from conftest import LOCAL, SPACE, timeless
from rich.console import Console

from dashboards.report.sections import figures, sections
from deltatune.publish import artifacts, publish
from deltatune.sweep_results import SweepResults
from orchestrator.analysis.contrasts.decisions import replay, rows
from orchestrator.analysis.findings import Findings, find
from orchestrator.errors import InterruptedSweepError
from orchestrator.execution.forecast import forecast
from orchestrator.execution.settings import Settings
from orchestrator.execution.sweep import run
from orchestrator.results.sweep_folder import Results
from search_spaces.loading import parse
from search_spaces.search_space import SearchSpace
from tests.orchestrator.local_sweeps import POOL, swept

AUTO = {"auto": {"group": 3, "max": 9, "alpha": 0.2}}
AGENTS: dict[str, dict[str, Any]] = {"q_learning": {}, "policy_reuse": {}, "ppr": {}, "delta_gate": {}}
"""Of these delta_gate does here what policy_reuse does, which stays undecided."""


def space(**changes: Any) -> SearchSpace:
    source = SPACE["scenarios"][0]["source"]  # type: ignore[index]
    scenarios = [{"source": source, "targets": ["windy_gridworld", "windy_gridworld:wind=reversed"]}]
    shorter = {"hyperparameters": {"episodes": [60]}, "agents": AGENTS}
    return parse("small", SPACE | {"seeds": AUTO, "scenarios": scenarios} | shorter | changes)


@pytest.fixture(scope="module")
def results(tmp_path_factory: pytest.TempPathFactory) -> Results:
    return swept(tmp_path_factory.mktemp("auto"), space())[0]


@pytest.fixture(scope="module")
def findings(results: Results) -> Findings:
    return find(results)


def transfers(results: Results) -> list[str]:
    return [cell.id for cell in results.plan()["transfer"]]


def test_decided_configurations_stop_and_the_others_take_the_whole_budget(results: Results, findings: Findings) -> None:
    seeds = {(group.task, group.agent, group.source): len(group.seeds) for group in findings.groups}
    states = {each.outcome.state for each in findings.decisions}
    assert states == {"better", "worse", "undecided"}
    for each in findings.decisions:
        spent = min(seeds[each.task, side.agent, side.source] for side in (each.first, each.second))
        assert each.seeds <= spent
        assert each.seeds % 3 == 0
        assert (each.seeds == 9) == (each.outcome.looks == 3)
        assert each.difference is not None
    assert min(seeds.values()) < max(seeds.values()) == 9
    assert replay(results.space(), findings.cells).further == 0


def test_the_cells_are_among_those_of_fixed_seeds_and_the_decisions_depend_on_their_values_alone(
    results: Results, findings: Findings, tmp_path: Path
) -> None:
    fixed, ran = swept(tmp_path, space(seeds=9))
    assert set(transfers(results)) < set(transfers(fixed))
    mine, theirs = results.heads(), fixed.heads()
    assert all(mine[cell].summary["auc"] == theirs[cell].summary["auc"] for cell in transfers(results))
    again, ran = swept(tmp_path, space())
    assert ran == 0, "every cell is there already"
    assert again.plan() == results.plan()
    assert find(again).decisions == findings.decisions
    assert find(fixed).decisions == findings.decisions


@pytest.mark.parametrize(
    "settings",
    [pytest.param(Settings(), id="ray", marks=[pytest.mark.ray, pytest.mark.slow]), pytest.param(POOL, id="processes")],
)
def test_all_executors_come_to_the_same_cells(
    results: Results, tmp_path: Path, settings: Settings, request: pytest.FixtureRequest
) -> None:
    if not settings.local:
        request.getfixturevalue("ray_session")
    other, _ = swept(tmp_path, space(), settings)
    for mine, theirs in zip(other.write_tables(), results.write_tables(), strict=True):
        pd.testing.assert_frame_equal(timeless(mine), timeless(theirs), check_exact=True)


@pytest.mark.parametrize(
    "after", [pytest.param(1, marks=pytest.mark.slow), 30, pytest.param(60, marks=pytest.mark.slow)]
)
def test_a_kill_changes_neither_cells_nor_decisions(
    results: Results, findings: Findings, tmp_path: Path, after: int
) -> None:
    broken = Results.create(tmp_path, "small", space())
    ended: list[object] = []

    def stop(stage: str, record: object) -> None:
        ended.append(record)
        if len(ended) == after:
            raise InterruptedSweepError

    summary = run(broken, LOCAL, Console(quiet=True), stop)
    assert summary.left > 0
    there = len(broken.heads())
    continued, ran = swept(tmp_path, space())
    assert ran == len(results.heads()) - there
    assert continued.plan() == results.plan()
    assert find(continued).decisions == findings.decisions
    assert swept(tmp_path, space())[1] == 0


def test_a_dry_run_says_the_least_and_the_most_and_nothing_is_left_in_the_end(results: Results, tmp_path: Path) -> None:
    before = forecast(space(), LOCAL, Results(tmp_path / "none"), workers=1)
    source, transfer = before.stages
    assert (source.cells, source.most) == (18, 18)
    assert (transfer.cells, transfer.most) == (3 * 2 * 7, 9 * 2 * 7)
    assert transfer.low < transfer.high
    after = forecast(space(), LOCAL, results, workers=1)
    assert [stage.cells - stage.done for stage in after.stages] == [0, 0]
    assert after.stages[1].most == after.stages[1].cells == len(transfers(results))
    assert after.start == 0


def test_a_failed_cell_ends_its_comparisons_and_no_other(results: Results, findings: Findings) -> None:
    table = findings.cells.copy()
    first = table[(table["agent"] == "ppr") & (table["seed"] == 1)].index
    table.loc[first, "status"], table.loc[first, "auc"] = "failed", None
    found = replay(results.space(), table)
    lost = [each for each in found.decisions if "ppr" in (each.first.agent, each.second.agent)]
    assert {each.outcome.state for each in lost} == {"lost"}
    assert {each.difference for each in lost} == {None}
    sides = [side for each in lost for side in (each.first, each.second) if side.agent == "ppr"]
    assert {found.looks[side.group] for side in sides} == {1}
    assert "lost" not in {each.outcome.state for each in found.decisions if each not in lost}


@pytest.mark.usefixtures("quick_figures")
def test_report_tables_and_python_have_the_decisions(results: Results) -> None:
    published = publish(results)
    found = published.findings
    shown, _ = sections(found, figures(found))
    section = next(section for section in shown if section.id == "decisions")
    assert "undecided means that the budget did not suffice" in section.lead
    page = (results.folder / "report.html").read_text()
    assert f"of {len(found.decisions)} comparisons decided" in page
    assert "3 to 9 seeds" in page
    table = pd.read_csv(results.folder / "decisions.csv")
    assert list(table["decision"]) == [each.outcome.state for each in found.decisions]
    assert list(SweepResults(results).decisions["seeds"]) == list(table["seeds"])
    assert results.folder / "decisions.csv" in artifacts(results)
    assert json.loads(table.to_json(orient="records"))[0]["a"] == found.decisions[0].first.agent
    assert len(rows(found.decisions)) == len(table)


def test_fixed_seeds_have_no_decisions(finished: Path) -> None:
    found = find(Results.open(finished, "small"))
    assert found.decisions == ()
    shown, absent = sections(found, figures(found))
    assert "decisions" not in {section.id for section in shown} | {each.name for each in absent}
