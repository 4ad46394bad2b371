"""The driver is asked to stop, or killed: what has ended is kept, the same command goes on, MLflow agrees with it."""

from __future__ import annotations

import os
import signal
import time
from pathlib import Path

import pytest
from conftest import DEEP, LONGER
from harness import PATIENCE, assert_same, driver, ended, on_start, sweep, wait_for

from orchestrator.execution import interrupt
from orchestrator.execution.settings import Settings
from orchestrator.execution.work_queue import Pack
from orchestrator.results.sweep_folder import Results
from trainables.storage import checkpoint


@pytest.mark.parametrize(
    ("number", "words"),
    [
        pytest.param(signal.SIGTERM, (), id="ray", marks=[pytest.mark.ray, pytest.mark.slow]),
        pytest.param(signal.SIGINT, ("--local", "--workers", "2"), id="processes"),
        pytest.param(signal.SIGINT, ("--local", "--workers", "1"), id="in-process", marks=pytest.mark.slow),
    ],
)
def test_a_sweep_that_is_asked_to_stop_ends_gracefully_and_goes_on(
    calm: Path, tmp_path: Path, number: signal.Signals, words: tuple[str, ...]
) -> None:
    with driver(tmp_path, "--no-mlflow", *words, **LONGER) as process:
        wait_for(ended(tmp_path, 6), process)
        process.send_signal(number)
        out, err = process.communicate(timeout=120)
    assert process.returncode == 130
    assert "interrupted: the same command continues from here" in err
    assert "Traceback" not in out + err
    there = len(Results.open(tmp_path, "small").heads())
    assert f"{there} cells run (0 failed), 0 reused, " in out
    _, tally = sweep(tmp_path, **LONGER)
    assert tally.reused == there
    assert_same(tmp_path, calm)


def test_deep_cells_are_checkpointed_before_an_interrupted_sweep_ends(tmp_path: Path) -> None:
    long = DEEP | {"hyperparameters": DEEP["hyperparameters"] | {"episodes": [100_000]}}
    words = ("--no-mlflow", "--local", "--workers", "2", "--seeds", "1", "--checkpoint-every", "10000")
    with driver(tmp_path, *words, **long) as process:
        wait_for(lambda: running(tmp_path), process)
        process.send_signal(signal.SIGINT)
        process.communicate(timeout=120)
    assert process.returncode == 130
    saved = {path.stem: checkpoint.load(path) for path in (tmp_path / "small" / "checkpoints").glob("*.checkpoint")}
    assert set(saved) == {cell.id for cell in Results.open(tmp_path, "small").plan()["source"]}
    assert all(len(state["points"]["episode"]) > 1 for state in saved.values())


def log(storage: Path) -> str:
    path = storage / "small" / "driver.log"
    return path.read_text() if path.exists() else ""


def running(storage: Path) -> bool:
    from orchestrator.results.progress import read

    snapshot = read(storage / "small")
    return snapshot is not None and snapshot.share > 0


SLOW = {"hyperparameters": {"episodes": [10**6], "evaluate_every": [10**6]}}


def test_a_second_ctrl_c_does_not_wait(tmp_path: Path) -> None:
    with driver(tmp_path, "--no-mlflow", "--local", "--workers", "2", **SLOW) as process:
        wait_for(lambda: "a worker has started" in log(tmp_path), process)
        process.send_signal(signal.SIGINT)
        wait_for(lambda: "stopping: running cells" in log(tmp_path), process)
        process.send_signal(signal.SIGINT)
        process.communicate(timeout=60)
    assert process.returncode == 130


def test_a_second_ctrl_c_does_not_wait_for_ray(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, ray_session: None
) -> None:
    workers, asked = list[int](), list[float]()
    monkeypatch.setattr(interrupt, "GRACE_SECONDS", PATIENCE)

    def twice(pack: Pack, pid: int) -> None:
        workers.append(pid)
        asked.append(time.monotonic())
        for _ in range(2):
            os.kill(os.getpid(), signal.SIGINT)

    on_start(monkeypatch, twice)
    _, tally = sweep(tmp_path, Settings(), **SLOW)
    assert tally.ran == 0
    assert tally.left > 0
    assert time.monotonic() - asked[-1] < PATIENCE / 4
    wait_for(lambda: not any(Path(f"/proc/{pid}").exists() for pid in workers))
