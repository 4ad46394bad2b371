"""Doubling the episodes of a sweep continues its finished cells: the bits of a sweep from scratch, half of the work."""

from __future__ import annotations

import io
import json
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
import yaml
from conftest import LOCAL, SPACE, timeless
from rich.console import Console

from orchestrator.execution.cells.longer import NO_STATE, OTHER_SOURCE, OTHER_VERSIONS
from orchestrator.execution.forecast import Forecast, forecast
from orchestrator.execution.settings import RunSummary, Settings
from orchestrator.execution.sweep import run
from orchestrator.results import other_sweeps
from orchestrator.results.admin import remove, rename
from orchestrator.results.sweep_folder import Results
from search_spaces.loading import parse
from search_spaces.search_space import SearchSpace
from tests.deltatune.cli.in_process import command
from tests.orchestrator.local_sweeps import POOL
from trainables.learners.dqn import DeepLearner
from trainables.learners.q_learning import TabularLearner
from trainables.storage import disk
from trainables.storage.paths import storage_path
from trainables.training.end_states import name_of

GRID = {"source": {"task": "windy_gridworld", "kinds": ["exact"]}, "targets": ["windy_gridworld:wind=reversed"]}
CART = {
    "source": {
        "task": "cartpole",
        "agent": "dqn",
        "hyperparameters": {"learning_rate": [0.001], "episodes": [10]},
    },
    "targets": ["cartpole:gravity=5x"],
}
TINY = {"evaluate_every": [10], "evaluation_episodes": [2], "hidden_size": [8], "batch_size": [8]}


@pytest.fixture(autouse=True)
def _however_short(monkeypatch: pytest.MonkeyPatch) -> None:
    """Keep the end states of the shortest cells too."""
    monkeypatch.setattr("orchestrator.execution.stage.LEAST_SECONDS", 0.0)
    monkeypatch.setattr("orchestrator.execution.stage.LEAST_SECONDS_REMOTE", 0.0)


def grid(episodes: int, **changes: Any) -> SearchSpace:
    """Cells of tabular agents."""
    agents = {"q_learning": {}, "ppr": {}, "delta_gate": {"threshold": [10.0, 3.0]}}
    hyperparameters = {"episodes": [episodes], "evaluate_every": [10]}
    given = {"scenarios": [GRID], "agents": agents, "hyperparameters": hyperparameters}
    return parse("small", SPACE | given | changes)


def cart(episodes: int, **changes: Any) -> SearchSpace:
    """Cells of deep agents, whose source has its own episodes."""
    agents: dict[str, Any] = {"dqn": {}, "delta_es": {}, "warm_start": {}}
    given = {"scenarios": [CART], "agents": agents, "hyperparameters": TINY | {"episodes": [episodes]}}
    return parse("small", SPACE | given | changes)


def swept(
    storage: Path, asked: SearchSpace, settings: Settings = LOCAL, name: str = "small"
) -> tuple[Results, RunSummary, str]:
    """The sweep after another run of it, its summary, and what it said."""
    said = io.StringIO()
    results = Results.create(storage, name, asked)
    summary = run(results, settings, Console(file=said, width=300))
    assert (summary.failed, summary.left) == (0, 0), said.getvalue()
    return results, summary, said.getvalue()


def points(results: Results) -> Any:
    return timeless(results.write_tables()[1])


def same_as_scratch(results: Results, asked: SearchSpace, folder: Path) -> None:
    """Check every bit against a sweep that trains everything from its first episode."""
    fresh, _, _ = swept(folder, asked)
    assert points(results).equals(points(fresh))


def states(results: Results) -> set[str]:
    folder = results.folder / "states"
    return {path.name for path in folder.iterdir()} if folder.exists() else set()


def expected(results: Results, stage: str | None = None) -> set[str]:
    """The end states of the planned cells."""
    return {name_of(cell) for name, cells in results.plan().items() for cell in cells if stage in (None, name)}


@pytest.mark.parametrize(
    ("settings", "space"),
    [
        (LOCAL, grid),
        (LOCAL, cart),
        (POOL, grid),
        pytest.param(Settings(), cart, marks=[pytest.mark.ray, pytest.mark.slow]),
    ],
    ids=["in process", "in process, deep", "processes", "Ray, deep"],
)
def test_twice_as_many_episodes_continue_with_the_bits_of_a_sweep_from_scratch(
    settings: Settings, space: Any, tmp_path: Path, request: pytest.FixtureRequest
) -> None:
    if not settings.local:
        request.getfixturevalue("ray_session")
    results, first, _ = swept(tmp_path / "a", space(30))
    assert states(results) == expected(results)
    results, second, said = swept(tmp_path / "a", space(60), settings)
    again = first.ran - (2 if space is cart else 0)  # the source networks stay
    assert (second.ran, second.continued) == (again, again)
    assert f"transfer: {again} cells continue shorter ones: {30 * again} of {60 * again} episodes are trained" in said
    same_as_scratch(results, space(60), tmp_path / "b")
    assert states(results) >= expected(results, "transfer")
    assert len(states(results)) == first.ran, "the outgrown ones are removed"
    assert swept(tmp_path / "a", space(60), settings)[1].ran == 0


@pytest.fixture
def steps(monkeypatch: pytest.MonkeyPatch) -> Iterator[dict[str, int]]:
    """How many environment steps this process trains."""
    count = {"trained": 0}

    def counted(kind: type, so_far: Any) -> None:
        plain = kind.run  # type: ignore[attr-defined]

        def counting(learner: Any, episodes: int) -> None:
            before = so_far(learner)
            plain(learner, episodes)
            count["trained"] += so_far(learner) - before

        monkeypatch.setattr(kind, "run", counting)

    counted(TabularLearner, lambda learner: int(learner._counts.steps[0]))
    counted(DeepLearner, lambda learner: learner.steps)
    yield count
    assert count["trained"] > 0


@pytest.mark.parametrize(("space", "most"), [(grid, 0.52), (cart, 0.75)])
def test_continuing_trains_what_is_new_and_nothing_else(
    space: Any, most: float, tmp_path: Path, steps: dict[str, int]
) -> None:
    """Half of the episodes; of the steps more or less, as learners come to make episodes longer or shorter."""
    results, _, _ = swept(tmp_path / "a", space(100))
    before = steps["trained"]
    results, _, _ = swept(tmp_path / "a", space(200))
    continued = steps["trained"] - before
    cells = results.plan()["transfer"]
    heads = results.heads()
    anew = sum(int(heads[cell.id].summary["steps"] or 0) for cell in cells)
    shorter = [head for head in heads.values() if head.cell.settings.episodes == 100]
    assert continued == anew - sum(int(head.summary["steps"] or 0) for head in shorter)
    assert continued <= most * anew


def test_the_dry_run_says_what_is_saved_and_writes_nothing(tmp_path: Path) -> None:
    results, _, _ = swept(tmp_path, grid(30))
    before = {path: path.read_bytes() for path in results.folder.rglob("*") if path.is_file()}

    def ahead(episodes: int) -> Forecast:
        return forecast(grid(episodes), LOCAL, results, workers=1)

    (stage,) = (stage for stage in ahead(60).stages if stage.stage == "transfer")
    assert (stage.longer.cells, stage.longer.episodes, stage.longer.saved) == (8, 480, 240)
    assert stage.longer.sentences() == ["8 cells continue shorter ones: 240 of 480 episodes are trained already"]
    (same,) = (stage for stage in ahead(120).stages if stage.stage == "transfer")
    assert stage.low == pytest.approx(same.low / 3)
    assert {path: path.read_bytes() for path in results.folder.rglob("*") if path.is_file()} == before


def test_cells_whose_source_network_is_another_one_start_anew_and_it_is_said_how_to_avoid_it(tmp_path: Path) -> None:
    scenario = {**GRID, "source": {"task": "windy_gridworld", "kinds": ["learned"]}}
    swept(tmp_path / "a", grid(30, scenarios=[scenario]))
    (_, stage) = forecast(grid(60, scenarios=[scenario]), LOCAL, Results(tmp_path / "a" / "small"), 1).stages
    assert (stage.longer.cells, stage.longer.anew) == (2, {OTHER_SOURCE: 6})
    results, summary, said = swept(tmp_path / "a", grid(60, scenarios=[scenario]))
    assert summary.continued == 2 + 2, "the sources, and the baseline"
    assert f"transfer: 6 longer cells start anew: {OTHER_SOURCE}" in said
    same_as_scratch(results, grid(60, scenarios=[scenario]), tmp_path / "b")
    kept = {**scenario, "source": {**scenario["source"], "hyperparameters": {"episodes": [60]}}}
    results, summary, _ = swept(tmp_path / "a", grid(90, scenarios=[kept]))
    assert (summary.ran, summary.continued) == (8, 8)
    same_as_scratch(results, grid(90, scenarios=[kept]), tmp_path / "c")


def test_each_reason_to_start_anew_is_said(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    auto = {"agents": {"delta_gate": {"threshold": ["auto"]}}}
    swept(tmp_path / "auto", grid(30, **auto))
    _, summary, said = swept(tmp_path / "auto", grid(60, **auto))
    assert (summary.ran, summary.continued) == (2, 0)
    why = "threshold: auto is measured over as many episodes as the cell has"
    assert f"transfer: 2 longer cells start anew: {why}" in said
    plain: dict[str, Any] = {"agents": {"q_learning": {}}, "seeds": 1}
    swept(tmp_path / "uneven", grid(35, **plain))
    assert "1 longer cell starts anew: 35 episodes are no multiple" in swept(tmp_path / "uneven", grid(70, **plain))[2]
    none = replace(LOCAL, keep_states=0.0)
    results, _, _ = swept(tmp_path / "none", grid(30, **plain), none)
    assert states(results) == set()
    assert f"1 longer cell starts anew: {NO_STATE}" in swept(tmp_path / "none", grid(60, **plain))[2]
    swept(tmp_path / "versions", grid(30, **plain))
    monkeypatch.setattr(other_sweeps, "versions", lambda: {"numpy": "0.0"})
    assert f"1 longer cell starts anew: {OTHER_VERSIONS}" in swept(tmp_path / "versions", grid(60, **plain))[2]


def test_a_sweep_continues_the_cells_of_another_one_of_its_storage_on_wish(tmp_path: Path) -> None:
    swept(tmp_path / "a", grid(30), name="first")
    every = replace(LOCAL, reuse="all")
    (_, stage) = forecast(grid(60), every, Results(tmp_path / "a" / "second"), 1).stages
    assert stage.longer.cells == 8
    results, summary, _ = swept(tmp_path / "a", grid(60), every, "second")
    assert (summary.ran, summary.continued) == (8, 8)
    assert len(states(Results.open(tmp_path / "a", "first"))) == 8, "another sweep's end states are its own"
    same_as_scratch(results, grid(60), tmp_path / "b")
    assert swept(tmp_path / "a", grid(60), LOCAL, "third")[1].continued == 0
    swept(tmp_path / "a", grid(20), LOCAL, "third")
    (_, stage) = forecast(grid(90), every, Results(tmp_path / "a" / "third"), 1).stages
    assert stage.longer.saved == 8 * 60, "the longest of them, wherever it is"


@pytest.mark.parametrize("harm", ["gone", "torn"])
def test_damaged_end_states_cost_their_cells_alone(harm: str, tmp_path: Path) -> None:
    results, first, _ = swept(tmp_path / "a", grid(30))
    for path in sorted((results.folder / "states").iterdir())[:3]:
        path.unlink() if harm == "gone" else path.write_bytes(path.read_bytes()[:-7])
    results, summary, _ = swept(tmp_path / "a", grid(60))
    assert (summary.ran, summary.continued) == (first.ran, first.ran - 3)
    assert ("starts anew: the end state" in (results.folder / "driver.log").read_text()) == (harm == "torn")
    same_as_scratch(results, grid(60), tmp_path / "b")


@pytest.mark.parametrize("what", ["list", "remove"])
def test_a_storage_that_does_not_answer_costs_the_saving_and_not_the_sweep(
    what: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    swept(tmp_path / "a", grid(30))

    def silent(path: Path) -> Any:
        if "states" in path.parts:
            raise TimeoutError("no answer")
        remove_file(path)

    remove_file = disk.remove
    target = "orchestrator.execution.cells.longer.sizes" if what == "list" else "trainables.storage.disk.remove"
    monkeypatch.setattr(target, silent)
    results, summary, _ = swept(tmp_path / "a", grid(60))
    assert (summary.ran, summary.continued) == (8, 0 if what == "list" else 8)
    why = {"list": "cannot list the end states in", "remove": "cannot be removed: no answer"}[what]
    assert why in (results.folder / "driver.log").read_text()
    same_as_scratch(results, grid(60), tmp_path / "b")


def test_end_states_move_and_go_with_their_sweep(tmp_path: Path) -> None:
    results, _, _ = swept(tmp_path, grid(30))
    moved = rename(results, "moved")
    assert swept(tmp_path, grid(60), name="moved")[1].continued == 8
    remove(moved)
    assert not list(tmp_path.rglob("*.state"))


def test_all_cells_of_a_stage_share_what_end_states_may_take(tmp_path: Path) -> None:
    results, _, _ = swept(tmp_path, grid(30))
    sizes = sorted(path.stat().st_size for path in (results.folder / "states").iterdir())
    between = (sizes[0] + sizes[-1]) / 2
    few = replace(LOCAL, keep_states=len(sizes) * between / 1e9)
    results, _, _ = swept(tmp_path / "few", grid(30), few)
    kept = [path.stat().st_size for path in (results.folder / "states").iterdir()]
    assert 0 < len(kept) < len(sizes)
    assert sum(kept) <= len(sizes) * between
    assert "MB that --keep-states leaves for it" in (results.folder / "driver.log").read_text()


def test_several_lengths_at_once_each_continue_what_there_is(tmp_path: Path) -> None:
    def lengths(*episodes: int) -> SearchSpace:
        return grid(0, hyperparameters={"episodes": list(episodes), "evaluate_every": [10]})

    swept(tmp_path / "a", lengths(30, 50))
    results, summary, said = swept(tmp_path / "a", lengths(30, 40, 60, 90))
    assert (summary.ran, summary.continued) == (24, 24)
    assert f"24 cells continue shorter ones: {8 * (30 + 50 + 50):,} of {8 * (40 + 60 + 90):,} episodes" in said
    same_as_scratch(results, lengths(30, 40, 60, 90), tmp_path / "b")


@pytest.mark.slow
def test_an_object_store_keeps_end_states_too(tmp_path: Path) -> None:
    storage = storage_path("memory://deltatune/longer")
    results, _, _ = swept(storage, grid(30))
    assert len(states(results)) == 8
    results, summary, _ = swept(storage, grid(60))
    assert (summary.ran, summary.continued) == (8, 8)
    assert states(results) == expected(results, "transfer")
    same_as_scratch(results, grid(60), tmp_path)


def test_confirmations_groups_of_seeds_and_early_stopping_continue_too(tmp_path: Path) -> None:
    confirmed = {"confirm": {"seeds": 2}, "agents": {"q_learning": {}, "delta_gate": {}}}
    _, first, _ = swept(tmp_path / "confirm", grid(30, **confirmed))
    results, summary, _ = swept(tmp_path / "confirm", grid(60, **confirmed))
    assert (summary.ran, summary.continued) == (first.ran, first.ran)
    same_as_scratch(results, grid(60, **confirmed), tmp_path / "b")
    auto = {"seeds": {"auto": {"group": 2, "max": 4}}, "agents": {"q_learning": {}, "delta_gate": {}}}
    swept(tmp_path / "auto", grid(30, **auto))
    ahead = forecast(grid(60, **auto), LOCAL, Results(tmp_path / "auto" / "small"), 1)
    assert ahead.stages[-1].longer.cells > 0
    results, summary, _ = swept(tmp_path / "auto", grid(60, **auto))
    assert summary.continued > 0
    same_as_scratch(results, grid(60, **auto), tmp_path / "c")


@pytest.mark.parametrize("search", [{"method": "random", "budget": 3}, {"method": "optuna", "budget": 3}])
def test_a_search_continues_the_configurations_that_it_tries_again(search: dict[str, Any], tmp_path: Path) -> None:
    scheduler = {"scheduler": {"method": "asha", "grace": 2, "reduction_factor": 2}}
    ranged = {"agents": {"ppr": {"nu": {"low": 0.9, "high": 0.99}}}, "search": search | scheduler}
    swept(tmp_path / "a", grid(40, **ranged))
    results, summary, _ = swept(tmp_path / "a", grid(80, **ranged))
    assert summary.continued > 0
    heads = results.heads()
    whole = {key: head for key, head in heads.items() if head.status == "done"}
    fresh, _, _ = swept(tmp_path / "b", grid(80, agents=ranged["agents"], search=search))
    shared = whole.keys() & fresh.heads().keys()
    assert shared
    assert all(whole[key].digest == fresh.heads()[key].digest for key in shared)


@pytest.mark.usefixtures("quick_figures")
def test_a_pretrained_source_stays_whatever_the_episodes_and_the_command_says_what_it_saves(tmp_path: Path) -> None:
    scenario = {**GRID, "source": {"task": "windy_gridworld", "kinds": ["learned"]}}
    results, _, _ = swept(tmp_path / "first", grid(30, scenarios=[scenario]))
    source = next((tmp_path / "first" / "sources").glob("*.npz"))
    (tmp_path / "space.yaml").write_text(yaml.safe_dump(results.space().to_json() | {"schema": 1}))
    words = [
        "sweep",
        str(tmp_path / "space.yaml"),
        "--storage",
        str(tmp_path / "a"),
        "--no-mlflow",
        "--local",
        "--json",
    ]
    words += ["--workers", "1", "--source", str(source)]
    told: list[dict[str, Any]] = []
    for more in ([], ["--set", "episodes=60", "--dry-run"], ["--set", "episodes=60", "--keep-states", "0"]):
        code, out, err = command(*words, *more)
        assert code == 0, err
        told.append(json.loads(out))
    first, ahead, second = told
    assert (first["tally"]["ran"], first["tally"]["continued"]) == (8, 0)
    assert [stage["longer"] for stage in ahead["stages"]][-1] == {"cells": 8, "episodes": 480, "saved": 240, "anew": {}}
    assert (second["tally"]["ran"], second["tally"]["continued"]) == (8, 8)
    assert len(states(Results.open(tmp_path / "a", "small"))) == 8, "those of 30 episodes, as no longer ones were kept"
