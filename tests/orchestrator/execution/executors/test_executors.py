"""Whoever runs the cells: the same bits, the same files, and a machine without Ray is enough."""

from __future__ import annotations

import json
import logging
import os
import signal
import subprocess
import sys
import threading
from dataclasses import replace
from pathlib import Path
from typing import Any

import pandas as pd
import pytest
import yaml
from conftest import CELLS, LOCAL, SPACE, timeless
from rich.console import Console

from orchestrator.execution import interrupt
from orchestrator.execution.executors import process_pool
from orchestrator.execution.interrupt import Interrupt
from orchestrator.execution.settings import RunSummary, Settings
from orchestrator.execution.sweep import run
from orchestrator.results.sweep_folder import Results
from search_spaces.loading import parse
from tests.orchestrator.local_sweeps import POOL
from tests.small_figures import ROOT

WITHOUT_RAY = """
import contextlib, json, sys
sys.path.append(sys.argv.pop(1))
class NoRay:
    def find_spec(self, name, path=None, target=None):
        if name.partition(".")[0] == "ray":
            raise ImportError("no Ray on this machine")
sys.meta_path.insert(0, NoRay())
from tests.small_figures import main
for words in json.loads(sys.argv[1]):
    sys.argv = ["deltatune", *words]
    with contextlib.suppress(SystemExit):
        main()
"""
"""Runs commands, one after the other."""


def sweep(storage: Path, settings: Settings, **changes: Any) -> tuple[Results, RunSummary]:
    results = Results.create(storage, "small", parse("small", SPACE | changes))
    return results, run(results, settings, Console(quiet=True))


def files(storage: Path) -> set[str]:
    """The names of a storage's files, but for those that only one moment has, and end states: slow cells have some."""
    paths = (path for path in storage.rglob("*") if path.is_file() and path.suffix != ".state")
    return {str(path.relative_to(storage)) for path in paths}


@pytest.mark.parametrize(
    "settings", [pytest.param(Settings(), id="ray", marks=pytest.mark.ray), pytest.param(POOL, id="processes")]
)
def test_all_executors_give_the_same_bits_and_files(
    finished: Path, tmp_path: Path, settings: Settings, request: pytest.FixtureRequest
) -> None:
    if not settings.local:
        request.getfixturevalue("ray_session")
    results, summary = sweep(tmp_path, settings)
    assert (summary.ran, summary.failed, summary.workers) == (CELLS, 0, 2)
    for mine, theirs in zip(results.write_tables(), Results.open(finished, "small").write_tables(), strict=True):
        pd.testing.assert_frame_equal(timeless(mine), timeless(theirs), check_exact=True)
    assert files(tmp_path) == files(finished)


@pytest.mark.parametrize("method", ["asha", "median"])
def test_early_stopping_and_search_work_in_processes_too(tmp_path: Path, method: str) -> None:
    scheduler = {"method": method, "grace": 3, "reduction_factor": 2}
    source = {"task": "windy_gridworld", "hyperparameters": {"learning_rate": [0.5, 0.3, 0.1, 0.05, 0.01, 0.002]}}
    _, summary = sweep(
        tmp_path,
        POOL,
        scenarios=[{"source": source, "targets": ["windy_gridworld:wind=reversed"]}],
        agents={"q_learning": {}, "delta_gate": {"threshold": [10.0]}},
        hyperparameters={"episodes": [400], "evaluate_every": [20]},
        search={"method": "grid", "scheduler": scheduler},
    )
    assert summary.failed == 0
    assert summary.stopped > 0


def test_a_sweep_of_a_machine_without_ray(tmp_path: Path) -> None:
    (tmp_path / "space.yaml").write_text(yaml.safe_dump(SPACE))
    words = ["sweep", str(tmp_path / "space.yaml"), "--storage", str(tmp_path), "--no-mlflow", "--local", "--workers"]
    commands = [[*words, "1", "--agents", "q_learning"], [*words, "2"]]
    code = [sys.executable, "-c", WITHOUT_RAY, ROOT, json.dumps(commands)]
    done = subprocess.run(code, capture_output=True, text=True)
    assert (done.returncode, done.stderr.count("Error")) == (0, 0), done.stderr
    assert "8 cells run (0 failed), 0 reused" in done.stdout
    assert "24 cells run (0 failed), 8 reused" in done.stdout
    assert (tmp_path / "small" / "report.html").exists()


def test_a_cell_over_its_time_limit_fails_at_its_next_evaluation_in_this_process(tmp_path: Path) -> None:
    from orchestrator.execution.executors import executor
    from orchestrator.execution.executors.in_process import InProcessExecutor

    slow = {"episodes": [10**7], "evaluate_every": [10**4]}
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("orchestrator.execution.stage.executor", InProcessExecutor)
        results, summary = sweep(
            tmp_path, replace(LOCAL, time_limit=0.2), seeds=1, agents={"q_learning": {}}, hyperparameters=slow
        )
    assert executor.executor(replace(LOCAL, time_limit=0.2)).__class__ is process_pool.ProcessPoolExecutor
    assert summary.failed == summary.ran > 0
    errors = {head.error for head in results.heads().values() if head.error}
    assert "it took longer than its time limit of 0.2 s" in errors


def test_a_worker_process_that_cannot_start_says_why(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(process_pool, "_MAIN", "raise SystemExit(7)")
    results, summary = sweep(tmp_path, POOL, seeds=1, agents={"q_learning": {}})
    assert summary.failed == summary.ran > 0
    assert all("its process has ended with exit code 7" in str(head.error) for head in results.heads().values())


def test_an_interrupt_waits_once_and_its_timer_ends_with_the_stage(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(interrupt, "GRACE_SECONDS", 0.2)
    ended = threading.Event()
    before = signal.getsignal(signal.SIGINT)
    with Interrupt(ended.set) as stage:
        os.kill(os.getpid(), signal.SIGINT)
        assert stage.requested
        assert ended.wait(10), "the grace is over"
    ended.clear()
    with Interrupt(ended.set):
        os.kill(os.getpid(), signal.SIGINT)
        os.kill(os.getpid(), signal.SIGINT)
        assert ended.is_set(), "the second one does not wait"
    ended.clear()
    with Interrupt(ended.set):
        os.kill(os.getpid(), signal.SIGINT)
    assert signal.getsignal(signal.SIGINT) is before
    with Interrupt(ended.set):
        assert not ended.wait(0.5), "the timer of the stage before is gone"


def test_warnings_of_workers_are_in_the_driver_log(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    """A file where the checkpoints of a worker should be."""
    from trainables.training import cell_run

    def full(*_: Any) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(cell_run.checkpoint, "save", full)
    results, summary = sweep(tmp_path, replace(LOCAL, checkpoint_seconds=0), seeds=1, agents={"q_learning": {}})
    assert summary.failed == 0
    log = (results.folder / "driver.log").read_text()
    assert "source: 2 cells to run" in log
    for head in results.heads().values():
        assert log.count(f"(cell {head.cell.id}): OSError: [Errno 28] No space left on device") == 1
    assert not [handler for handler in logging.getLogger("deltatune").handlers if "caplog" not in str(handler).lower()]
