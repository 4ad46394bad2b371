"""How far a stage is, in one line."""

from __future__ import annotations

import logging
from pathlib import Path

import pytest

from orchestrator.results import driver_log, progress
from orchestrator.results.progress import Progress
from orchestrator.results.records.record import Record
from trainables import curve
from trainables.cell import Cell
from trainables.curve import EvalPoint
from trainables.storage.paths import storage_path


def ended(task: str, value: float, agent: str = "q_learning") -> Record:
    points = curve.columns([EvalPoint(0, 10, value, value, None, {})])
    cell = Cell.create(agent, task, 0)
    return Record(
        cell=cell,
        status="done",
        error=None,
        points=points,
        digest=curve.digest(points),
        seconds=0.1,
        finished=1.0,
        versions={},
        commit="unknown",
    )


def test_the_best_auc_is_of_one_task() -> None:
    stage = Progress("transfer", 4)
    assert stage.snapshot().best == ""
    for task, value in (("cartpole", 200.0), ("acrobot", -90.0), ("acrobot", -300.0)):
        stage.ended(ended(task, value, "dqn"))
    # 200 in CartPole says nothing of Acrobot
    assert stage.snapshot().best == "best AUC on acrobot: -90.0 (dqn)"
    stage.ended(ended("cartpole", 10.0, "dqn"))
    assert stage.snapshot().best == "best AUC on cartpole: 200.0 (dqn)"


def test_the_rate_and_what_is_left_count_from_when_the_stage_was_first_heard_of(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    now = 100.0
    monkeypatch.setattr(progress.time, "monotonic", lambda: now)
    stage = Progress("source", 2)
    stage.share("a", 0.5, 40_000)  # it continues from a checkpoint
    first = stage.snapshot()
    assert (first.steps_per_second, first.seconds_left) == (None, None)
    now += 10
    stage.share("a", 0.6, 48_000)
    later = stage.snapshot()
    assert later.rate() == "800 steps/s"
    assert later.left() == "about 2 min left"


def test_the_cell_during_which_kernels_were_compiled_says_nothing_of_the_time_left(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    now = 100.0
    monkeypatch.setattr(progress.time, "monotonic", lambda: now)
    stage = Progress("source", 20)
    stage.compiling()
    assert "compiling" in stage.snapshot().line()
    now += 60
    stage.ended(ended("cartpole", 100.0, "dqn"))
    assert "compiling" not in stage.snapshot().line()
    now += 2
    for _ in range(9):
        stage.ended(ended("cartpole", 100.0, "dqn"))
    assert stage.snapshot().left() == "about 2 s left"


class ConnectTimeoutError(Exception):
    """What a client of an object store raises: no OSError."""


def away(*_: object, **__: object) -> None:
    raise ConnectTimeoutError("the bucket does not answer")


def test_a_storage_that_is_away_costs_the_progress_and_the_log_not_the_sweep(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    bucket = storage_path("memory://deltatune/away")
    monkeypatch.setattr(progress, "write_atomic", away)
    with driver_log.logging_to(bucket):
        monkeypatch.setattr(type(bucket), "write_text", away)
        progress.write(bucket, Progress("transfer", 4).snapshot())
        logging.getLogger("deltatune.results").info("something else")
    assert "the progress cannot be written to memory://deltatune/away: the bucket does not answer" in caplog.text


def test_a_log_that_could_not_be_written_says_so_once_it_can(monkeypatch: pytest.MonkeyPatch) -> None:
    bucket = storage_path("memory://deltatune/again")
    with driver_log.logging_to(bucket):
        log = logging.getLogger("deltatune.sweep")
        with monkeypatch.context() as broken:
            broken.setattr(type(bucket), "write_text", away)
            for message in ("one", "two"):
                log.info(message)
                driver_log.flush()
        log.info("three")
    told = [line.split(" ", 2)[2] for line in driver_log.read(bucket).splitlines()]
    assert told == [
        "one",
        "memory://deltatune/again/driver.log cannot be written: the bucket does not answer",
        "two",
        "three",
    ]


def test_a_log_on_a_disk_that_cannot_be_written_costs_nothing_else(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    (tmp_path / driver_log.FILE).mkdir()
    with driver_log.logging_to(tmp_path):
        for message in ("one", "two"):
            logging.getLogger("deltatune.sweep").info(message)
    written = [record for record in caplog.records if "driver.log cannot be written" in record.getMessage()]
    assert len(written) == 1


def test_a_disk_that_cannot_be_written_to_costs_the_progress_alone(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    (tmp_path / "file").touch()
    with caplog.at_level(logging.INFO, driver_log.LOGGER):
        progress.write(tmp_path / "file", Progress("transfer", 4).snapshot())
    assert "the progress cannot be written to" in caplog.text
