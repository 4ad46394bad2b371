"""`deltatune sweep --name NAME` alone: the sweep continues with the search space of its last run."""

from __future__ import annotations

import json
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from orchestrator.results.sweep_folder import Results
from search_spaces.loading import load
from search_spaces.narrow import narrow
from search_spaces.search_space import SearchSpace
from tests.deltatune.cli.in_process import command

EXAMPLES = Path(__file__).parents[3] / "docs" / "examples"

OWN = """\
schema: 1
name: own
seeds: 1
scenarios:
  - source: {task: "tank.py:Task", agent: dqn}
    targets: ["tank.py:Task:leak=2x"]
agents: {dqn: {}, es: {}}
hyperparameters: {episodes: 4, evaluate_every: 2, evaluation_episodes: 1, hidden_size: 8, batch_size: 8}
"""


@pytest.mark.usefixtures("quick_figures")
def test_a_narrowed_sweep_continues_narrowed(tmp_path: Path) -> None:
    there = ("--storage", str(tmp_path), "--local", "--no-mlflow", "--json")
    small = ("--seeds", "1", "--agents", "delta_gate", "--set", "episodes=40", "--name", "small")
    code, _, err = command("sweep", "demo", *small, *there)
    assert code == 0, err
    results = Results.open(tmp_path, "small")
    space, plan = results.space(), results.plan()
    lost = sorted(results.heads())[0]
    shutil.rmtree(results.folder / "records")
    code, _, err = command("sweep", "--name", "small", *there)
    assert code == 0, err
    again = Results.open(tmp_path, "small")
    assert (again.space(), again.plan()) == (space, plan)
    assert lost in again.heads()


def test_a_narrowed_sweep_is_narrowed_further_never_widened(tmp_path: Path) -> None:
    there = ("--storage", str(tmp_path), "--local", "--no-mlflow", "--dry-run")
    results = Results.create(tmp_path, "small", _small())
    assert command("sweep", "--name", "small", "--agents", "delta_gate", *there)[0] == 0
    code, _, err = command("sweep", "--name", "small", "--agents", "policy_reuse", *there)
    assert code == 2
    assert "policy_reuse" in err
    assert results.space() == _small()


def test_a_sweep_of_another_storage_is_not_taken_for_one_of_this(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    Results.create(tmp_path, "small", _small())
    monkeypatch.chdir(tmp_path)
    code, _, err = command("sweep", "--name", "small", "--local", "--no-mlflow")
    assert code == 2
    assert f"no sweep 'small' in results; the one in {tmp_path} needs --storage" in " ".join(err.split())
    assert not (tmp_path / "results").exists()


@pytest.mark.parametrize(
    ("words", "said"),
    [
        ((), "sweep requires a search space, or the --name of a sweep to continue"),
        (("--name", "none"), "none"),
        (("--name", "../up"), "a sweep's name must be letters"),
    ],
)
def test_what_is_no_sweep_is_refused_in_a_sentence(words: tuple[str, ...], said: str, tmp_path: Path) -> None:
    code, _, err = command("sweep", *words, "--storage", str(tmp_path))
    assert code == 2
    assert said in err
    assert len(err.strip().splitlines()) == 1
    assert not list(tmp_path.iterdir())


def test_a_sweep_with_custom_code_asks_for_its_file_and_runs_with_it(tmp_path: Path) -> None:
    shutil.copy(EXAMPLES / "tank.py", tmp_path)
    (tmp_path / "own.yaml").write_text(OWN)
    options = ("--local", "--no-mlflow", "--json")
    ran = _shell(tmp_path, "sweep", "own.yaml", *options)
    assert ran.returncode == 0, ran.stderr
    refused = _shell(tmp_path, "sweep", "--name", "own", *options)
    assert refused.returncode == 2
    assert "--file tank.py" in refused.stderr
    assert "Traceback" not in refused.stderr
    done = _shell(tmp_path, "sweep", "--name", "own", "--file", "tank.py", *options)
    assert done.returncode == 0, done.stderr
    assert json.loads(done.stdout)["tally"]["ran"] == 0


def _shell(folder: Path, *words: str) -> subprocess.CompletedProcess[str]:
    line = [sys.executable, "-m", "deltatune", *words]
    return subprocess.run(line, cwd=folder, capture_output=True, text=True, check=False, timeout=300)


def _small() -> SearchSpace:
    return narrow(load("demo"), agents=["delta_gate"], seeds=1)
