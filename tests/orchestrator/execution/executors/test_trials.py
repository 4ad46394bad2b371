"""Which trials Tune gets: packs of one stage after the other, and trials that hold idle workers for the next stage."""

from __future__ import annotations

import json
from collections.abc import Iterator
from types import SimpleNamespace
from typing import Any

import pytest

from orchestrator.errors import InterruptedSweepError
from orchestrator.execution.executors import trials as module
from orchestrator.execution.executors.trials import Trials
from orchestrator.execution.work_queue import CellStatus, WorkQueue
from trainables.cell import Cell
from trainables.training.tune_worker import HOLD

CELLS = [Cell.create("q_learning", "windy_gridworld", seed, {"episodes": 10}) for seed in range(4)]


@pytest.fixture(autouse=True)
def no_ray(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "ray", SimpleNamespace(put=lambda payload: f"ref of {payload}"))


def stage(name: str, cells: list[Cell], *, followed: bool = True, at_once: int | None = 2, workers: int = 0) -> Any:
    queue = WorkQueue(CellStatus(lambda cell: False, lambda cells: None), at_once, list(cells))
    there = {(number, "node") for number in range(workers)}
    return SimpleNamespace(
        monitor=SimpleNamespace(queue=queue, next=queue.next, workers=there), payload=name, followed=followed
    )


def opened(*stages: Any, asked: Any = lambda: False, error: Exception | None = None) -> Trials:
    def rest() -> Iterator[Any]:
        yield from stages[1:]
        if error is not None:
            raise error

    return Trials(stages[0], rest(), asked)


def complete(trials: Trials, trial: str) -> None:
    trials.let_go(trial)
    trials.monitor.queue.on_completed(trial)


def test_an_idle_worker_is_held_until_the_next_stage_begins() -> None:
    trials = opened(stage("one", CELLS[:1]), stage("two", CELLS[1:3], followed=False))
    first = trials.next("a")
    assert first is not None
    assert (json.loads(first["cells"])[0]["seed"], first["payload"]) == (0, "ref of one")
    held = trials.next("b")  # the second worker starts now, though only the next stage needs it
    assert held == {HOLD: module.HOLD_SECONDS}
    assert trials.next("c") is None, "a worker is held once"
    assert trials.holds("b")
    complete(trials, "a")
    second = trials.next("d")
    assert second is not None
    assert second["payload"] == "ref of two"
    assert not trials.holds("b"), "the next stage has begun"
    complete(trials, "b")
    third = trials.next("e")
    assert third is not None
    assert trials.next("f") is None
    complete(trials, "d")
    assert trials.next("g") is None, "no stage may follow: nobody is held"
    complete(trials, "e")
    assert trials.next("h") is None
    assert trials.over
    trials.finish()


def test_a_pack_that_comes_back_gets_the_worker_that_was_held() -> None:
    trials = opened(stage("one", CELLS[:2]), stage("two", CELLS[2:], followed=False))
    trials.next("a")
    queue = trials.monitor.queue
    trials.next("b")
    complete(trials, "b")
    assert trials.next("c") == {HOLD: module.HOLD_SECONDS}
    queue.on_lost("a", "gone")
    assert not trials.holds("c")
    again = trials.next("d")
    assert again is not None
    assert "cells" in again
    complete(trials, "c")
    assert trials.next("e") == {HOLD: module.HOLD_SECONDS}, "and is held again"


def test_a_worker_whose_time_is_over_is_not_held_again() -> None:
    trials = opened(stage("one", CELLS[:1]))
    trials.next("a")
    assert trials.next("b") == {HOLD: module.HOLD_SECONDS}
    complete(trials, "b")
    assert trials.next("c") is None


def test_a_cluster_holds_the_workers_that_have_started_alone() -> None:
    trials = opened(stage("one", CELLS[:1], at_once=None, workers=2))
    trials.next("a")
    assert trials.next("b") == {HOLD: module.HOLD_SECONDS}
    assert trials.next("c") is None


def test_an_interrupt_holds_nobody_and_begins_nothing() -> None:
    asked = []
    trials = opened(
        stage("one", CELLS[:1]), stage("two", CELLS[1:]), asked=lambda: bool(asked), error=InterruptedSweepError()
    )
    trials.next("a")
    trials.next("b")
    asked.append(True)
    assert trials.next("c") is None
    assert not trials.holds("b")
    complete(trials, "a")
    assert trials.next("d") is None
    assert trials.over
    with pytest.raises(InterruptedSweepError):
        trials.finish()


def test_an_error_of_planning_comes_out_once_tune_has_ended() -> None:
    trials = opened(stage("one", CELLS[:1]), error=OSError("the disk is full"))
    trials.next("a")
    complete(trials, "a")
    assert trials.next("b") is None
    assert trials.over
    with pytest.raises(OSError, match="the disk is full"):
        trials.finish()


def test_a_stage_in_which_tune_was_stopped_is_ended() -> None:
    ended = opened(stage("one", CELLS[:1]), error=InterruptedSweepError())
    ended.next("a")
    with pytest.raises(InterruptedSweepError):
        ended.finish()
    more = opened(stage("one", CELLS[:1]), stage("two", CELLS[1:]))
    with pytest.raises(InterruptedSweepError):
        more.finish()
