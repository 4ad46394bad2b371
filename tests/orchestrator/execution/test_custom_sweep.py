"""Custom tasks and agents in a sweep, from the command line: the examples of the documents, and code that is wrong."""

from __future__ import annotations

import json
import shutil
from pathlib import Path
from typing import Any

import pytest
import yaml
from conftest import LOCAL
from rich.console import Console

from orchestrator.analysis.groups import groups
from orchestrator.execution.forecast import forecast
from orchestrator.execution.replay import replay
from orchestrator.execution.settings import RunSummary, Settings
from orchestrator.execution.sweep import run
from orchestrator.results.sweep_folder import Results
from search_spaces.loading import load
from search_spaces.narrow import narrow
from search_spaces.search_space import SearchSpace
from search_spaces.template import starter
from trainables.custom import load as load_name
from trainables.errors import InputError
from trainables.plugins import loader

ROOT = Path(__file__).parents[3]
EXAMPLES = ROOT / "docs" / "examples"
SHORT = {"episodes": 4, "evaluate_every": 2, "evaluation_episodes": 2, "hidden_size": 8, "batch_size": 8}


@pytest.fixture
def home(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder with the examples, where the test runs."""
    for path in (*EXAMPLES.glob("*.py"), ROOT / "tests" / "trainables" / "plugins" / "bad_tasks.py"):
        shutil.copy(path, tmp_path)
    monkeypatch.chdir(tmp_path)
    return tmp_path


def space(home: Path, source: dict[str, Any], targets: list[str], agents: dict[str, Any], **more: Any) -> SearchSpace:
    data = {"schema": 1, "name": "own", "seeds": 1, "scenarios": [{"source": source, "targets": targets}]}
    (home / "own.yaml").write_text(yaml.safe_dump(data | {"agents": agents} | more))
    return load(str(home / "own.yaml"))


def sweep(home: Path, asked: SearchSpace) -> tuple[Results, RunSummary]:
    results = Results.create(home / "results", "own", asked)
    return results, run(results, LOCAL, Console(quiet=True))


def test_every_example_is_complete_and_short() -> None:
    assert {path.name: len(path.read_text().splitlines()) < 40 for path in EXAMPLES.glob("*.py")} == {
        "tank.py": True,
        "fading_advice.py": True,
    }


def test_a_custom_task_is_swept_resumed_forecast_and_replayed(home: Path) -> None:
    source = {"task": "tank.py:Task", "agent": "dqn"}
    asked = space(home, source, ["tank.py:Task:leak=1.5x"], {"dqn": {}, "es": {}}, hyperparameters=SHORT)
    ahead = forecast(asked, Settings(), Results(home / "results" / "own"), workers=2)
    assert [(stage.stage, stage.cells, stage.done) for stage in ahead.stages] == [("source", 1, 0), ("transfer", 2, 0)]
    assert all(0 < stage.low <= stage.high for stage in ahead.stages)
    assert not (home / "results").exists()
    results, tally = sweep(home, asked)
    assert (tally.ran, tally.failed) == (3, 0)
    assert sweep(home, asked)[1].ran == 0
    after = forecast(asked, Settings(), results, workers=2)
    assert [(stage.cells, stage.done, stage.high) for stage in after.stages] == [(1, 1, 0.0), (2, 2, 0.0)]
    longer = narrow(asked, hyperparameters={"episodes": 6})
    assert {cost.origin for cost in forecast(longer, Settings(), results, workers=2).costs} == {"1 earlier cells"}
    for cells in results.plan().values():
        assert all(replay(home / "results", cell.id).agrees for cell in cells)
    (home / "tank.py").write_text((home / "tank.py").read_text() + "# edited\n")
    edited = forecast(load("own.yaml"), Settings(), results, workers=2)
    assert [(stage.cells, stage.done) for stage in edited.stages] == [(1, 0), (2, 0)]


def test_results_of_custom_code_are_read_the_same_where_it_is_not(home: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    asked = space(
        home,
        {"task": "windy_gridworld", "kinds": ["exact"]},
        ["windy_gridworld:wind=small"],
        {"q_learning": {}, "fading_advice.py:Agent": {"trust": [1.0, 10.0]}},
        hyperparameters={"episodes": 20},
        seeds=2,
    )
    results, tally = sweep(home, asked)
    assert (tally.ran, tally.failed) == (6, 0)
    before = groups(results.write_tables()[0])
    assert sum(group.against_base is not None for group in before) == 2
    cell = next(cell for cell in results.plan()["transfer"] if cell.sources)
    monkeypatch.setattr(loader, "_LOADED", {})
    monkeypatch.setattr("trainables.agents.custom._AGENTS", {})
    again = Results(results.folder)
    assert groups(again.write_tables()[0]) == before
    assert again.space() == asked
    with pytest.raises(InputError, match=r"the agent fading_advice\.py@\w+:Agent needs fading_advice\.py as it was"):
        replay(home / "results", cell.id)
    (home / "fading_advice.py").write_text((home / "fading_advice.py").read_text() + "# edited\n")
    loader.load_file("fading_advice.py")
    with pytest.raises(InputError, match=r"is of another fading_advice\.py: the file is @\w+ now, it was @\w+ then"):
        replay(home / "results", cell.id)
    shutil.copy(EXAMPLES / "fading_advice.py", home)
    loader.load_file("fading_advice.py")
    assert replay(home / "results", cell.id).agrees


THREADED = """
import torch

from deltatune import StepLearner, Transfer, agent


class Threaded(StepLearner):
    def statistics(self):
        return {"threads": torch.get_num_threads()}


class Settings(Transfer):
    pass


Agent = agent(Threaded, Settings, base="q_learning")
"""
"""An agent whose numbers depend on the threads of its process, as sums of several threads do."""


def test_a_cell_is_replayed_with_as_many_threads_as_its_worker_had(home: Path) -> None:
    torch = pytest.importorskip("torch")
    (home / "threaded.py").write_text(THREADED)
    results, tally = sweep(
        home,
        space(
            home,
            {"task": "windy_gridworld", "kinds": ["exact"]},
            ["windy_gridworld:wind=small"],
            {"threaded.py:Agent": {}},
            hyperparameters={"episodes": 2, "evaluate_every": 1},
        ),
    )
    assert tally.failed == 0
    (cell,) = results.plan()["transfer"]
    before = torch.get_num_threads()
    torch.set_num_threads(2)
    try:
        found = replay(home / "results", cell.id)
        assert found.agrees, found
    finally:
        torch.set_num_threads(before)


def test_custom_code_that_is_wrong_fails_its_cells_and_no_others(home: Path) -> None:
    names = ["Reset", "Shape", "Nan", "Multi", "Words"]
    targets = ["bad_tasks.py:Good:wind=0.1", *(f"bad_tasks.py:{name}" for name in names)]
    asked = space(home, {"task": "bad_tasks.py:Good", "agent": "dqn"}, targets, {"dqn": {}}, hyperparameters=SHORT)
    results, tally = sweep(home, asked)
    assert (tally.ran, tally.failed) == (7, 5)
    errors = [record.error for _, _, record in results.records() if record and record.status == "failed"]
    assert all("(bad_tasks.py:" in str(error) and "\n" not in str(error) for error in errors)
    assert len(set(errors)) == 5


def test_targets_of_another_shape_are_refused_before_any_work(home: Path) -> None:
    with pytest.raises(InputError, match=r"levels=5 has observations \(2,\) and 5 actions, the source .* 3 actions"):
        space(home, {"task": "bad_tasks.py:Cut", "agent": "dqn"}, ["bad_tasks.py:Cut:levels=5"], {"dqn": {}})


@pytest.mark.parametrize(
    ("typed", "source", "targets"),
    [
        ("tank.py:Task", "tank.py:Task", ["tank.py:Task:leak=1.5x", "tank.py:Task:pump=0.5x"]),
        ("tank.py:Task:leak=3x", "tank.py:Task", ["tank.py:Task:leak=0.15"]),
        ("cartpole", "cartpole", ["cartpole:gravity=5x", "cartpole:gravity=7x"]),
        ("supply_chain", "supply_chain", ["supply_chain:demand_mean=2", "supply_chain:demand_mean=5"]),
        ("gym:Pendulum-v1:g=2x,levels=5", "gym:Pendulum-v1:levels=5", ["gym:Pendulum-v1:levels=5,g=20"]),
        ("gym:Acrobot-v1", "gym:Acrobot-v1", ["gym:Acrobot-v1"]),
    ],
)
def test_a_starter_file_is_a_space_for_every_kind_of_task(
    home: Path, typed: str, source: str, targets: list[str]
) -> None:
    name = load_name(typed) if ".py" in typed else typed
    Path("mine.yaml").write_text(starter(typed, name, "mine.yaml"))
    data = yaml.safe_load(Path("mine.yaml").read_text())
    assert (data["scenarios"][0]["source"]["task"], data["scenarios"][0]["targets"]) == (source, targets)
    assert len(load("mine.yaml").agents) >= 3


@pytest.mark.parametrize("typed", ["tank.py:Task", "windy_gridworld"])
def test_a_starter_file_runs_as_it_is(home: Path, typed: str) -> None:
    Path("mine.yaml").write_text(starter(typed, load_name(typed) if ".py" in typed else typed, "mine.yaml"))
    known = {"hidden_size": 8, "evaluation_episodes": 2} if ".py" in typed else {}
    asked = narrow(load("mine.yaml"), seeds=1, hyperparameters={"episodes": 4, "evaluate_every": 2, **known})
    _, tally = sweep(home, asked)
    assert tally.failed == 0
    assert tally.ran > 6


def test_a_forecast_counts_searches_and_says_what_it_cannot_measure(home: Path) -> None:
    asked = space(
        home,
        {"task": "bad_tasks.py:Good", "agent": "dqn"},
        ["bad_tasks.py:Reset"],
        {"dqn": {"learning_rate": {"low": 0.001, "high": 0.1}}},
        hyperparameters=SHORT,
        search={"method": "random", "budget": 7},
        seeds=3,
    )
    ahead = forecast(asked, Settings(), Results(home / "results" / "own"), workers=1)
    assert [(stage.cells, stage.done) for stage in ahead.stages] == [(3, 0), (21, 0)]
    assert len(ahead.unknown) == 1
    assert "the simulator is not there" in ahead.unknown[0]


def test_the_notes_of_a_sweep_are_data(home: Path) -> None:
    asked = space(home, {"task": "tank.py:Task", "agent": "dqn"}, ["tank.py:Task"], {"dqn": {}})
    results = Results.create(home / "results", "own", asked)
    notes = json.loads((results.folder / "own.json").read_text())
    assert [key.partition("@")[0] for key in notes if key not in ("schema", "checksum")] == ["tank.py"]
    (results.folder / "own.json").write_text("[broken")
    assert Results(results.folder).space() == asked
