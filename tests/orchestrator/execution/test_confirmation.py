"""Confirmation: what was selected runs again on unseen seeds, beside its baselines, and is judged by them."""

from __future__ import annotations

import json
from collections import Counter
from dataclasses import replace
from pathlib import Path
from typing import Any

import pandas as pd
import pytest
import yaml
from conftest import LOCAL, SPACE
from rich.console import Console

from dashboards.report.sections import figures, sections, winners
from dashboards.report.tables import Table
from dashboards.report.verdict import verdict
from deltatune.publish import publish
from orchestrator.analysis.findings import Findings, find
from orchestrator.errors import InterruptedSweepError
from orchestrator.execution.forecast import forecast
from orchestrator.execution.sweep import run
from orchestrator.export.best_params import best, read_params
from orchestrator.planning.confirmation import CONFIRMATION, check_confirmation
from orchestrator.planning.source_choice import SourceRun
from orchestrator.results.sweep_folder import Results
from orchestrator.tracking.mlflow.fields import group_figures, places
from search_spaces.loading import parse
from search_spaces.narrow import narrow
from search_spaces.search_space import FIRST_UNSEEN_SEED, SearchSpace
from tests.orchestrator.local_sweeps import swept
from trainables.cell import Cell
from trainables.errors import InputError

UNSEEN = tuple(range(FIRST_UNSEEN_SEED, FIRST_UNSEEN_SEED + 3))


def space(**changes: Any) -> SearchSpace:
    return parse("small", SPACE | {"confirm": {"seeds": 3}, "hyperparameters": {"episodes": [30]}} | changes)


@pytest.fixture(scope="module")
def results(tmp_path_factory: pytest.TempPathFactory) -> Results:
    return swept(tmp_path_factory.mktemp("confirmed"), space())[0]


@pytest.fixture(scope="module")
def findings(results: Results) -> Findings:
    return find(results)


def test_the_unseen_seeds_are_the_same_however_a_sweep_grows() -> None:
    assert space().confirm_seeds == space(seeds=7).confirm_seeds == UNSEEN
    assert space(seeds=[0, UNSEEN[1]]).confirm_seeds == (UNSEEN[0], UNSEEN[2], UNSEEN[2] + 1)
    assert narrow(parse("small", SPACE), confirm=3).confirm_seeds == UNSEEN
    assert parse("small", SPACE).confirm_seeds == ()


@pytest.mark.parametrize("confirm", [{"seeds": 0}, {"seeds": 1001}, {"seeds": True}, {"seed": 3}, 20])
def test_a_confirmation_that_makes_no_sense_is_refused(confirm: Any) -> None:
    with pytest.raises(InputError, match="confirm"):
        space(confirm=confirm)


def test_every_selected_configuration_is_confirmed_on_unseen_seeds_alone(findings: Findings) -> None:
    selected = [one.best for key, one in findings.selected.items() if one.best.stage == "transfer"]
    assert len(selected) == 2 * (1 + 2 + 2)
    for group in selected:
        assert group.confirmed is not None
        assert group.seeds == (0, 1)
        assert group.confirmed.seeds == UNSEEN
        assert group.confirmed.hyperparameters == group.hyperparameters
        assert group.confirmed.id != group.id
        assert (group.confirmed.against_base is None) == (group.source == "none")
        assert group.against_base is None or group.confirmed.against_base.seeds == 3
    assert {group.id for group in findings.groups}.isdisjoint(group.id for group in findings.confirmations)


def test_an_unseen_seed_has_its_own_source_where_the_pick_says_so(results: Results) -> None:
    plan = results.plan()
    own = {cell.id: cell.seed for cell in plan["confirm_source"]}
    assert sorted(own.values()) == list(UNSEEN)
    learned = [cell for cell in plan["confirm"] if cell.sources and cell.sources[0].kind == "learned"]
    assert learned
    assert all(own[str(cell.sources[0].cell_id)] == cell.seed for cell in learned)


def test_its_cells_have_no_part_in_selecting(results: Results, findings: Findings) -> None:
    without = find(results, (findings.cells[~findings.cells["stage"].isin(CONFIRMATION)], findings.points))
    assert {key: one.best.id for key, one in without.selected.items()} == {
        key: one.best.id for key, one in findings.selected.items()
    }
    assert [group.auc for group in without.groups] == [group.auc for group in findings.groups]


def test_a_baseline_with_other_hyperparameters_than_its_own_best_is_confirmed_too(tmp_path: Path) -> None:
    agents = {"q_learning": {"learning_rate": [0.5, 0.1]}, "delta_gate": {"learning_rate": [0.5, 0.1]}}
    scenario = SPACE["scenarios"][0] | {"targets": ["windy_gridworld:wind=reversed"]}  # type: ignore[index]
    results, _ = swept(tmp_path, space(agents=agents, scenarios=[scenario]))
    for group in (one.best for one in find(results).selected.values() if one.best.base_id):
        assert group.confirmed is not None
        assert group.confirmed.against_base is not None


def test_resuming_runs_nothing_and_more_unseen_seeds_run_those_alone(tmp_path: Path) -> None:
    _, first = swept(tmp_path, space())
    assert first == 4 + 28 + 3 + 30
    assert swept(tmp_path, space())[1] == 0
    results, more = swept(tmp_path, space(confirm={"seeds": 4}))
    assert more == 1 + 10
    assert {len(group.seeds) for group in find(results).confirmations} == {4}


def test_a_sweep_that_ended_without_is_confirmed_later_and_forgets_it_when_no_more_asked(tmp_path: Path) -> None:
    plain = parse("small", SPACE | {"hyperparameters": {"episodes": [30]}})
    results, _ = swept(tmp_path, plain)
    before = find(results)
    ahead = forecast(space(), LOCAL, results, workers=1)
    assert [(stage.stage, stage.cells, stage.done) for stage in ahead.stages[2:]] == [
        ("confirm_source", 3, 0),
        ("confirm", 30, 0),
    ]
    results, ran = swept(tmp_path, space())
    assert ran == 33
    ahead = forecast(space(), LOCAL, results, workers=1)
    assert [(stage.cells, stage.done) for stage in ahead.stages] == [(4, 4), (28, 28), (3, 3), (30, 30)]
    results, ran = swept(tmp_path, plain)
    assert ran == 0
    after = find(results)
    assert after.confirmations == []
    assert [group.id for group in after.groups] == [group.id for group in before.groups]
    assert len(after.cells) == len(before.cells)


def test_what_a_kill_leaves_is_counted_and_done_by_the_next_run(tmp_path: Path) -> None:
    results = Results.create(tmp_path, "small", space())

    def stop(stage: str, record: object) -> None:
        if stage == "confirm":
            raise InterruptedSweepError

    summary = run(results, LOCAL, Console(quiet=True), stop)
    assert summary.left == 65 - len(results.heads())
    assert 0 < summary.left < 30
    assert swept(tmp_path, space())[1] == summary.left


@pytest.mark.parametrize("pick", ["best_evaluated", "each", 1])
def test_other_picks_give_the_unseen_seeds_the_networks_that_there_are(tmp_path: Path, pick: Any) -> None:
    scenario: dict[str, Any] = json.loads(json.dumps(SPACE["scenarios"]))[0]
    scenario["source"] |= {"pick": pick, "kinds": ["learned"]}
    results, _ = swept(tmp_path, space(scenarios=[scenario], agents={"q_learning": {}, "delta_gate": {}}))
    plan = results.plan()
    assert plan["confirm_source"] == []
    networks = {cell.sources[0].cell_id for cell in plan["confirm"] if cell.sources}
    assert networks == {cell.sources[0].cell_id for cell in plan["transfer"] if cell.sources}
    gate = next(one.best for key, one in find(results).selected.items() if key.agent == "delta_gate")
    assert gate.confirmed is not None
    assert (gate.confirmed.networks, gate.confirmed.seeds) == (2 if pick == "each" else 1, UNSEEN)


def test_early_stopping_stops_no_cell_of_a_confirmation(tmp_path: Path) -> None:
    scheduler = {"method": "median", "grace": 1}
    asked = space(search={"scheduler": scheduler}, hyperparameters={"episodes": [30], "evaluate_every": [5]})
    results, _ = swept(tmp_path, asked)
    heads = results.heads()
    assert {heads[cell.id].status for cell in results.plan()["confirm"]} == {"done"}


def test_a_pretrained_source_of_each_seed_serves_no_unseen_one() -> None:
    cells = [Cell.create("q_learning", "windy_gridworld", seed) for seed in (0, 1)]
    runs = {"windy_gridworld": {cell.seed: SourceRun(cell, 0.0, 0.0, 0) for cell in cells}}
    with pytest.raises(InputError, match="confirm: the unseen seeds have no pretrained source of their own"):
        check_confirmation(space(), runs)
    for asked in (parse("small", SPACE), space(scenarios=[picked("best_evaluated")])):
        check_confirmation(asked, runs)
    one = {"windy_gridworld": dict.fromkeys((0, 1, *UNSEEN), runs["windy_gridworld"][0])}
    check_confirmation(space(), one)


def picked(pick: str) -> dict[str, Any]:
    scenario: dict[str, Any] = json.loads(json.dumps(SPACE["scenarios"]))[0]
    scenario["source"]["pick"] = pick
    return scenario


@pytest.mark.usefixtures("quick_figures")
def test_every_view_has_the_confirmed_figure_beside_the_selected_one(
    results: Results, findings: Findings, tmp_path: Path
) -> None:
    published = publish(results)
    assert published.missing == []
    entries = {
        (e["task"], e["agent"], e["source"]): e
        for e in yaml.safe_load((results.folder / "best.yaml").read_text())["best"]
    }
    for group in findings.best:
        entry = entries[group.task, group.agent, group.source]
        assert group.confirmed is not None
        assert entry["seeds"] == [0, 1]
        assert entry["confirmed"]["seeds"] == list(UNSEEN)
        assert entry["confirmed"]["auc"]["value"] == group.confirmed.auc.value
        metrics, tags = group_figures(group)
        assert metrics["auc"] == group.auc.value
        assert metrics["confirmed_auc"] == group.confirmed.auc.value
        assert tags["unseen seeds"] == "3"
    assert set(read_params(results.folder / "best.yaml")) == set(findings.selected)
    texts = pd.read_csv(results.folder / "table.csv")
    assert (texts["confirmed AUC mean (sd)"] != "-").sum() == len(findings.best)
    numbers = pd.read_csv(results.folder / "configurations.csv")
    assert numbers["confirmed_auc"].notna().sum() == len(findings.best)
    shown = next(one for one in sections(findings, figures(findings))[0] if one.id == "results")
    assert isinstance(shown.content[0], Table)
    assert "unseen seeds" in [title for title, _ in shown.content[0].columns]
    assert "unseen seeds, which had no part in selecting them" in shown.lead
    judged = Counter(group.confirmed.verdict for group in findings.best if group.confirmed)
    answer = verdict(findings, winners(findings))
    assert (answer.helped, answer.hurt) == (judged["helped"], judged["hurt"])
    assert all("on 3 unseen seeds" in sentence for _, _, sentence in answer.winners)
    assert not set(places(findings.groups)) & {group.id for group in findings.confirmations}


def test_nothing_is_said_of_confirmation_where_none_was_asked_for(finished: Path) -> None:
    results = Results.open(finished, "small")
    found = find(results)
    assert all("confirmed" not in entry for entry in best(found)["best"])
    said = " ".join(map(str, sections(found, figures(found))[0]))
    assert "Confirmed:" not in said
    assert "confirmed AUC" not in said


def test_a_verdict_is_the_confirmations(findings: Findings) -> None:
    group = next(group for group in findings.best if group.against_base)
    assert group.judged is group.confirmed
    assert replace(group, confirmed=None).judged.verdict == group.verdict
