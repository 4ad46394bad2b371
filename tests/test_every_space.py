"""Every built-in search space, and one of custom code: from loading to replay.

A feature that was finished alone never met the others; here each meets every space.
"""

from __future__ import annotations

import contextlib
from pathlib import Path
from typing import Any

import pandas as pd
import pytest
import yaml
from conftest import LOCAL
from rich.console import Console

from deltatune.publish import publish
from orchestrator.analysis.contrasts.decisions import replay as replay_test
from orchestrator.analysis.findings import find
from orchestrator.execution.cells.sequential import needed, needed_at_most
from orchestrator.execution.forecast import forecast
from orchestrator.execution.replay import replay
from orchestrator.execution.sweep import run
from orchestrator.export import formats
from orchestrator.planning.arms import Arm
from orchestrator.planning.params import check_params, keys
from orchestrator.planning.plan import source_arms, transfer_arms
from orchestrator.planning.source_choice import settle, untrained
from orchestrator.results.sweep_folder import Results
from orchestrator.results.tables.cell_row import cell_row
from orchestrator.tracking.sync import sync
from orchestrator.tracking.uri import tracking_uri
from search_spaces.loading import built_in, load, parse
from search_spaces.narrow import narrow
from search_spaces.search_space import SearchSpace
from tests.small_figures import small_figures
from trainables.agents.registry import agent_named
from trainables.cell import Cell
from trainables.errors import InputError
from trainables.tasks.registry import parse_task

pytestmark = pytest.mark.usefixtures("quick_mlflow")

DRAWN = {"demo", "paper-table1", "custom-task", "custom-agent"}
"""Spaces whose figures are drawn as they are; those of the others are drawn small."""

EXAMPLES = Path(__file__).parents[1] / "docs" / "examples"
TANK, LEAK = "tank.py:Task", "tank.py:Task:leak=0.1"
CUSTOM = {
    "custom-task": {
        "schema": 1,
        "name": "custom-task",
        "seeds": 2,
        "scenarios": [
            {"source": {"task": TANK, "agent": "dqn", "library": [LEAK]}, "targets": [f"{TANK}:leak=1.5x", LEAK]}
        ],
        "agents": {"dqn": {}, "delta_es": {}, "delta_select_es": {}},
        "hyperparameters": {"episodes": 4, "hidden_size": 8},
        "normalise": {TANK: [-10, -1], f"{TANK}:leak=1.5x": [-12, -1]},
    },
    "custom-agent": {
        "schema": 1,
        "name": "custom-agent",
        "seeds": 2,
        "scenarios": [
            {
                "source": {"task": "windy_gridworld", "kinds": ["learned", "exact"]},
                "targets": ["windy_gridworld:wind=small"],
            }
        ],
        "agents": {"q_learning": {}, "fading_advice.py:Agent": {"trust": [1.0, 10.0]}, "delta_gate": {}},
        "hyperparameters": {"episodes": 4},
    },
}


@pytest.fixture(params=[*built_in(), *CUSTOM])
def space(request: pytest.FixtureRequest, tmp_path: Path) -> SearchSpace:
    """Every space in turn; those of custom code from YAML files beside it."""
    return loaded(request.param, tmp_path)


def loaded(asked: str, tmp_path: Path) -> SearchSpace:
    """A space by its name."""
    if asked in built_in():
        return load(asked)
    for name in ("tank.py", "fading_advice.py"):
        (tmp_path / name).write_bytes((EXAMPLES / name).read_bytes())
    (tmp_path / "custom.yaml").write_text(yaml.safe_dump(CUSTOM[asked]))
    return load(str(tmp_path / "custom.yaml"))


def planned(space: SearchSpace) -> tuple[list[Arm], list[Arm]]:
    """The arms of both stages, as if the first configuration of each source were the best."""
    sources = source_arms(space, {})
    transfers = transfer_arms(space, settle(sources, {}, lambda arm: untrained(arm, steps=1000)), {})
    return [arm for scenario in sources for arm in scenario.values()], transfers


def test_each_agent_and_each_target_alone_is_a_space_that_can_be_planned(space: SearchSpace) -> None:
    targets = list(dict.fromkeys(parse_task(name).name for each in space.scenarios for name in each.targets))
    for agent in space.agents:
        for target in targets:
            part = narrow(space, tasks=[target], agents=[agent], seeds=1)
            assert parse(part.name, part.to_json()) == part
            sources, transfers = planned(part)
            assert {arm.agent for arm in transfers} == {agent}
            # a family's own name stands for all of its targets
            assert {target} <= {arm.task for arm in transfers} <= ({target} if ":" in target else set(targets))
            assert all(bool(arm.sources) == agent_named(agent).needs_source for arm in transfers)
            for arm in (*sources, *transfers):
                cells = arm.some_cells()
                assert all(arm.owns(cell) for cell in cells)
                assert all(Cell.from_json(cell.to_json()) == cell for cell in cells)


def test_every_arm_of_a_whole_space_has_a_key_of_its_own_and_a_baseline(space: SearchSpace) -> None:
    space = narrow(space, seeds=1)
    sources, transfers = planned(space)
    assert len({arm.key for arm in transfers}) == len(transfers)
    wanted = {key if key.kind != "none" else key._replace(source_task="") for key in keys(space)}
    assert {arm.key for arm in (*sources, *transfers)} == wanted
    base = {(arm.task, arm.agent) for arm in transfers if not arm.sources}
    for arm in (arm for arm in transfers if arm.sources):
        name = agent_named(arm.agent).base
        assert name not in space.agents or (arm.task, name) in base


def test_what_a_space_has_settled_is_what_it_runs(space: SearchSpace) -> None:
    space = narrow(space, seeds=1)
    sources, transfers = planned(space)
    params = {arm.key: _first(arm) for arm in (*sources, *transfers)}
    assert check_params("best.yaml", params, space) == ""
    arms = source_arms(space, params)
    again = transfer_arms(space, settle(arms, {}, untrained), params)
    assert {arm.key: arm.grid for arm in again} == {arm.key: (params[arm.key],) for arm in transfers}


def _first(arm: Arm) -> dict[str, Any]:
    """All hyperparameters of the arm's first configuration."""
    return agent_named(arm.agent).resolve(parse_task(arm.task), arm.first()).model_dump()


MINIATURE: dict[str, Any] = {
    "episodes": 4,
    "evaluate_every": 2,
    "evaluation_episodes": 1,
    "hidden_size": 8,
    "batch_size": 8,
}
"""What makes a cell of any agent last some milliseconds."""


def miniature(space: SearchSpace) -> SearchSpace:
    """One seed, one target of each scenario, each agent's first configuration, and a few episodes."""
    data = narrow(space, seeds=1).to_json()
    for scenario in data["scenarios"]:
        scenario["targets"] = scenario["targets"][:1]
        scenario["source"]["hyperparameters"] = _firsts(scenario["source"].get("hyperparameters", {}))
    data["agents"] = {agent: _firsts(options) for agent, options in data["agents"].items()}
    data["hyperparameters"] = _firsts(data.get("hyperparameters", {}))
    data["search"] = {}
    small = parse(space.name, data)
    known = {name for agent in small.agents for name in agent_named(agent).hyperparameters.model_fields}
    return narrow(small, hyperparameters={name: value for name, value in MINIATURE.items() if name in known})


def _firsts(options: dict[str, Any]) -> dict[str, Any]:
    """The first value of each option."""
    return {name: option["values"][:1] if "values" in option else [option["low"]] for name, option in options.items()}


def snapshot(folder: Path) -> dict[str, bytes]:
    return {str(path): path.read_bytes() for path in sorted(folder.rglob("*")) if path.is_file()}


@pytest.mark.filterwarnings("ignore")
def test_a_space_in_miniature_is_forecast_run_reported_exported_tracked_and_replayed(
    space: SearchSpace, tmp_path: Path
) -> None:
    with contextlib.nullcontext() if space.name in DRAWN else small_figures():
        from_forecast_to_replay(miniature(space), tmp_path)


def from_forecast_to_replay(small: SearchSpace, tmp_path: Path) -> Results:
    """Do with a small space all that can be done."""
    storage = tmp_path / "storage"
    storage.mkdir()
    forecast(small, LOCAL, Results(storage / small.name), workers=1)
    assert snapshot(storage) == {}
    results = Results.create(storage, small.name, small)
    summary = run(results, LOCAL, Console(quiet=True))
    assert (summary.failed, summary.left) == (0, 0), [head.error for head in results.heads().values()]
    assert summary.ran > 0
    before = snapshot(storage)
    ahead = forecast(small, LOCAL, results, workers=1)
    assert [stage.cells - stage.done for stage in ahead.stages] == [0] * len(ahead.stages)
    assert snapshot(storage) == before, "a dry run writes nothing"
    published = publish(results)
    if small.normalise:
        assert published.findings.over_tasks.tasks
        judged = {group.task for group in published.findings.best if group.stage == "transfer"}
        assert set(published.findings.over_tasks.tasks) == judged, "each target has its reference values"
    assert published.report.exists()
    deep = any(agent_named(name).kind == "deep" for name in small.agents)
    for name in formats.FORMATS:
        if name == "sb3" and not deep:
            with pytest.raises(InputError, match="has no deep agent"):
                formats.write(published.findings, name, tmp_path / f"out-{name}")
        else:
            formats.write(published.findings, name, tmp_path / f"out-{name}")
    uri = tracking_uri(storage, None)
    sync(published.findings, uri, [])
    one = {cell.agent: cell for cells in results.plan().values() for cell in cells}
    assert all(replay(storage, cell.id).agrees for cell in one.values())
    assert run(results, LOCAL, Console(quiet=True)).ran == 0
    return results


def doubled(small: SearchSpace) -> SearchSpace:
    """A space in miniature with twice as many episodes, but for its sources."""
    data = small.to_json()
    data["hyperparameters"]["episodes"] = {"values": [2 * MINIATURE["episodes"]]}
    for scenario in data["scenarios"]:
        scenario["source"]["hyperparameters"]["episodes"] = {"values": [MINIATURE["episodes"]]}
    return parse(small.name, data)


ALL_AGENTS = ("baselines", "choose-source", *CUSTOM)
"""Spaces that have every built-in agent between them, and custom code."""


@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize(
    "name", [*ALL_AGENTS, *(pytest.param(n, marks=pytest.mark.slow) for n in built_in() if n not in ALL_AGENTS)]
)
def test_twice_as_many_episodes_continue_every_agent_of_every_space_to_the_bits_of_a_replay(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("orchestrator.execution.stage.LEAST_SECONDS", 0.0)
    small = miniature(loaded(name, tmp_path))
    results = Results.create(tmp_path, small.name, small)
    run(results, LOCAL, Console(quiet=True))
    before = results.plan()
    ahead = forecast(doubled(small), LOCAL, results, workers=1)
    results = Results.create(tmp_path, small.name, doubled(small))
    summary = run(results, LOCAL, Console(quiet=True))
    after = results.plan()
    assert after["source"] == before["source"], "the sources stay"
    apart = {cell.id for cell in before["transfer"]}
    longer = {cell.agent: cell for cell in after["transfer"] if cell.id not in apart}
    assert {cell.agent for cell in after["transfer"]} == set(longer)
    custom = sum(agent_named(cell.agent).origin == "custom" for cell in after["transfer"])
    assert (summary.ran, summary.failed) == (len(after["transfer"]), 0)
    assert summary.continued == summary.ran - custom == sum(stage.longer.cells for stage in ahead.stages)
    assert all(replay(tmp_path, cell.id).agrees for cell in longer.values())


def by_groups(space: SearchSpace) -> SearchSpace:
    """The space with a sequential test over two groups of two seeds."""
    return parse(space.name, space.to_json() | {"seeds": {"auto": {"group": 2, "max": 4}}})


def test_a_sequential_test_compares_every_agent_of_every_space_with_what_it_builds_on(space: SearchSpace) -> None:
    asked = by_groups(space)
    _, transfers = planned(asked)
    first = needed(asked, transfers, {})
    every = needed_at_most(asked, transfers, None)
    assert {cell.seed for cell in first} == {0, 1}
    assert 2 * len(first) == len(every)
    rows = [cell_row("transfer", cell, None, arm.label) for arm in transfers for cell in arm.all_cells()]
    found = replay_test(asked, pd.DataFrame(rows))
    assert {each.outcome.state for each in found.decisions} == {"open"}
    based = {arm.agent for arm in transfers if agent_named(arm.agent).base in asked.agents}
    targets = {arm.task for arm in transfers}
    assert {(each.task, each.first.agent) for each in found.decisions} >= {(t, a) for t in targets for a in based}
    assert {each.first.agent for each in found.decisions}.isdisjoint(asked.agents.keys() - based)
    assert found.further == len(first)


@pytest.mark.filterwarnings("ignore")
@pytest.mark.usefixtures("quick_figures")
@pytest.mark.parametrize(
    "name",
    ["demo", *(pytest.param(n, marks=pytest.mark.slow) for n in ("smoke-table1", "custom-task")), "custom-agent"],
)
def test_a_sequential_test_over_seeds_goes_from_forecast_to_replay(name: str, tmp_path: Path) -> None:
    results = from_forecast_to_replay(by_groups(miniature(loaded(name, tmp_path))), tmp_path)
    found = find(results)
    assert found.decisions
    assert {each.outcome.state for each in found.decisions} <= {"better", "worse", "undecided"}
    assert {len(group.seeds) for group in found.groups if group.stage == "transfer"} <= {2, 4}


def crossed(space: SearchSpace, pick: str = "each") -> SearchSpace:
    """The space with two source networks, crossed with the seeds or ranked, and a confirmation."""
    data = space.to_json() | {"confirm": {"seeds": 2}}
    for scenario in data["scenarios"]:
        if "learned" in scenario["source"]["kinds"]:
            scenario["source"] |= {"pick": pick, "seeds": [0, 7]}
    return parse(space.name, data)


def test_source_networks_are_crossed_with_the_seeds_in_every_space(space: SearchSpace) -> None:
    asked = crossed(narrow(space, seeds=3))
    sources, transfers = planned(asked)
    assert {arm.key for arm in transfers if arm.sources} <= set(keys(asked))
    assert all(arm.seeds == ((0, 7) if arm.key.kind == "none" else (0, 1, 2)) for arm in sources if arm.ranges == {})
    for arm in transfers:
        cells = arm.some_cells()
        networks = 2 if arm.key.kind == "learned" else 1
        assert len(cells) % (3 * networks) == 0
        assert arm.width == 3 * networks
        assert len({cell.id for cell in cells}) == len(cells)
        assert all(arm.owns(cell) for cell in cells)


FEW = ("q_learning", "delta_gate", "dqn", "delta_es")
"""A base and a transfer agent of each kind: agents are crossed with source networks all in the same way."""


@pytest.mark.filterwarnings("ignore")
@pytest.mark.usefixtures("quick_figures")
@pytest.mark.parametrize(
    ("name", "pick"),
    [
        ("demo", "each"),
        ("custom-agent", "each"),
        ("custom-task", "ranked"),
        pytest.param("demo", "ranked", marks=pytest.mark.slow),
        pytest.param("custom-agent", "ranked", marks=pytest.mark.slow),
        pytest.param("custom-task", "each", marks=pytest.mark.slow),
        pytest.param("smoke-table1", "each", marks=pytest.mark.slow),
        pytest.param("smoke-table1", "ranked", marks=pytest.mark.slow),
    ],
)
def test_several_source_networks_go_from_forecast_to_replay(name: str, pick: str, tmp_path: Path) -> None:
    asked = miniature(loaded(name, tmp_path))
    agents = [agent for agent in asked.agents if agent in FEW] if name in built_in() else ()
    small = crossed(narrow(asked, seeds=2, agents=agents), pick)
    results = from_forecast_to_replay(small, tmp_path)
    found = find(results)
    learned = [group for group in found.best if group.source == "learned"]
    assert learned
    assert {(group.networks, len(group.seeds), group.pick) for group in learned} == {
        (2 if pick == "each" else 1, 2, pick)
    }
    for group in (group for group in found.best if group.stage == "transfer"):
        assert group.confirmed is not None
        assert (group.confirmed.networks, len(group.confirmed.seeds)) == (group.networks, 2)
    assert set(found.cells["source_seed"].dropna()) <= {0, 7}
