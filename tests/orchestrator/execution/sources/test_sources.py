"""Sources of a sweep that runs: two of one target, two picks of one, and one that fails."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest
from rich.console import Console
from typer.testing import CliRunner

from deltatune.cli.main import app
from orchestrator.analysis.findings import find
from orchestrator.execution.forecast import forecast
from orchestrator.execution.settings import RunSummary, Settings
from orchestrator.execution.sweep import run
from orchestrator.export.best_params import read_params, write_best
from orchestrator.model_registry.source_models import source_models
from orchestrator.results.status import sweep_status
from orchestrator.results.sweep_folder import Results
from search_spaces.loading import load, parse
from search_spaces.narrow import narrow
from search_spaces.search_space import SearchSpace

ORIGIN, SMALL, REVERSED = "windy_gridworld", "windy_gridworld:wind=small", "windy_gridworld:wind=reversed"
HERE = Settings(local=True, workers=1)

BROKEN = '''
import gymnasium
import numpy as np
from gymnasium.spaces import Box, Discrete

from trainables.custom import feature, task


class Env(gymnasium.Env):
    """Ten steps of nothing, unless it has a fault."""

    def __init__(self, fault=0.0, size=1.0):
        self.fault, self.size = fault, size
        self.observation_space, self.action_space = Box(-9, 9, (1,), np.float32), Discrete(2)

    def reset(self, *, seed=None, options=None):
        super().reset(seed=seed)
        if self.fault:
            raise RuntimeError("out of order")
        return np.array([self.size], np.float32), {}

    def step(self, action):
        return np.array([self.size], np.float32), float(action), False, False, {}


Task = task(Env, feature("fault", 0.0, 0, 1, "breaks"), feature("size", 1.0, 0, 9, "what is seen"), limit=10)
'''


def sweep(storage: Path, space: SearchSpace, **how: Any) -> tuple[Results, RunSummary]:
    results = Results.create(storage, space.name, space)
    return results, run(results, Settings(local=True, workers=1, **how), Console(quiet=True))


def two(*sources: dict[str, Any], seeds: int = 2) -> SearchSpace:
    rates = {"learning_rate": [0.5, 0.1]}
    scenarios = [{"source": {"hyperparameters": rates, **source}, "targets": [REVERSED]} for source in sources]
    data = {"schema": 1, "name": "two", "seeds": seeds, "scenarios": scenarios, "hyperparameters": {"episodes": 30}}
    return parse("two", data | {"agents": {"q_learning": {}, "delta_gate": {}}})


def test_two_sources_of_one_target_each_have_a_ratio_and_an_entry_that_comes_back(tmp_path: Path) -> None:
    space = two({"task": ORIGIN}, {"task": SMALL})
    results, summary = sweep(tmp_path, space)
    assert summary.failed == 0
    findings = find(results)
    compared = {group.source_task: group.against_base for group in findings.best if group.agent == "delta_gate"}
    assert set(compared) == {ORIGIN, SMALL}
    assert all(compared.values())
    data = write_best(findings, tmp_path / "best.yaml")
    again, summary = sweep(tmp_path / "again", space, params=read_params(tmp_path / "best.yaml"))
    assert summary.failed == 0
    gates = [entry["auc"] for entry in data["best"] if entry["agent"] == "delta_gate"]
    assert [group.auc.value for group in find(again).best if group.agent == "delta_gate" and group.auc] == [
        auc["value"] for auc in gates
    ]


def test_two_picks_of_one_source_are_two_rows_and_are_resumed(tmp_path: Path) -> None:
    space = two({"task": ORIGIN}, {"task": ORIGIN, "pick": "best_evaluated"})
    results, summary = sweep(tmp_path, space)
    # of the two picks, the better seed gets the same knowledge: one cell of both
    assert (summary.ran, summary.failed) == (4 + 2 + 3, 0)
    picks = {group.pick: group for group in find(results).best if group.agent == "delta_gate"}
    assert set(picks) == {"own_seed", "best_evaluated"}
    assert all(group.seeds == (0, 1) and group.against_base for group in picks.values())
    assert sweep(tmp_path, space)[1].ran == 0
    models = [model.cell.id for model in source_models(results)]
    assert len(models) == 2


def test_a_dry_run_of_a_library_counts_what_runs(tmp_path: Path) -> None:
    space = narrow(load("choose-source"), tasks=[SMALL], seeds=1, hyperparameters={"episodes": 20})
    ahead = forecast(space, HERE, Results(tmp_path / "choose-source"), workers=1)
    assert not (tmp_path / "choose-source").exists()
    results, summary = sweep(tmp_path, space)
    assert summary.failed == 0
    plan = results.plan()
    assert [stage.cells for stage in ahead.stages] == [len(plan["source"]), len(plan["transfer"])] == [5, 19]
    after = forecast(space, HERE, results, workers=1)
    assert [(stage.cells, stage.done) for stage in after.stages] == [(5, 5), (19, 19)]


@pytest.fixture
def broken(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A search space of a source that cannot be trained and one that can."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "faulty.py").write_text(BROKEN)
    scenarios = [
        {"source": {"task": f"faulty.py:Task{source}", "agent": "dqn"}, "targets": [f"faulty.py:Task:size={size}"]}
        for source, size in (("", 2), (":fault=1", 3))
    ]
    short = {"episodes": 2, "evaluate_every": 1, "evaluation_episodes": 1, "hidden_size": 8, "batch_size": 4}
    data = {"schema": 1, "name": "broken", "seeds": 1, "scenarios": scenarios, "agents": {"dqn": {}, "es": {}}}
    (tmp_path / "broken.yaml").write_text(json.dumps(data | {"hyperparameters": short}))
    return tmp_path


def test_a_source_that_fails_takes_its_own_transfers_with_it_and_no_others(broken: Path) -> None:
    space = load("broken.yaml")
    results, summary = sweep(broken / "results", space)
    # both sources and the sound scenario's dqn and es ran; the other scenario's two cells could not
    assert (summary.ran, summary.failed) == (6, 3)
    records = [record for stage, _, record in results.records() if stage == "transfer" and record]
    assert {(record.cell.task[-1], record.cell.agent): record.status for record in records} == {
        ("2", "dqn"): "done",
        ("2", "es"): "done",
        ("3", "dqn"): "failed",
        ("3", "es"): "failed",
    }
    why = {record.error for record in records if record.status == "failed"}
    assert len(why) == 1
    assert "no configuration of dqn on the source task" in (text := str(why.pop()))
    assert "out of order" in text
    status = sweep_status(results)
    assert status["stages"]["transfer"] == {"done": 2, "failed": 2, "stopped": 0, "missing": 0}
    assert len(status["failures"]) == 3
    assert sweep(broken / "results", space)[1].ran == 0
    assert sweep(broken / "results", space, retry_failed=True)[1].ran == 3
    assert [group.agent for group in find(results).best if group.against_base] == ["es"]


@pytest.mark.usefixtures("quick_figures")
def test_a_sweep_with_a_lost_source_ends_with_a_table_a_report_and_exit_code_1(broken: Path) -> None:
    result = CliRunner().invoke(app, ["sweep", "broken.yaml", "--local", "--workers", "1", "--no-mlflow", "--json"])
    assert result.exit_code == 1, result.output
    data = json.loads(result.stdout)
    assert Path(data["report"]).is_file()
    assert [entry["agent"] for entry in data["best"]["best"]] == ["dqn", "dqn", "es"]
