"""Workers die, hang and run out of memory: the cell in question fails at the worst, all others end with their bits."""

from __future__ import annotations

import os
import signal
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from conftest import CELLS, LOCAL
from harness import assert_same, driver, on_start, sweep

from orchestrator.execution import work_queue
from orchestrator.execution.settings import Settings
from orchestrator.execution.work_queue import Pack
from orchestrator.results.sweep_folder import Results
from tests.small_figures import DRAWN_SMALL
from trainables.cell import Cell
from trainables.learners import dqn
from trainables.learners.replay_buffer import Replay

POOL = Settings(local=True, workers=2)


def victim(storage: Path) -> Cell:
    """A cell of the middle of the transfer stage."""
    return Results.open(storage, "small").plan()["transfer"][5]


def test_ray_survives_a_lost_worker_a_cell_that_kills_its_workers_and_one_that_hangs(
    finished: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, ray_session: None
) -> None:
    plan = Results.open(finished, "small").plan()["transfer"]
    deadly, hanging, killed = plan[5], plan[11], list[int]()
    monkeypatch.setattr(work_queue, "MAX_WORKER_LOSSES", 2)  # each worker of Ray takes seconds to start

    def harm(pack: Pack, pid: int) -> None:
        if not killed or deadly in pack.cells:
            killed.append(pid)
            os.kill(pid, signal.SIGKILL)
        elif hanging in pack.cells:
            os.kill(pid, signal.SIGSTOP)

    with monkeypatch.context() as patch:
        on_start(patch, harm)
        results, tally = sweep(tmp_path, Settings(time_limit=8))
    assert (tally.ran, tally.failed) == (CELLS, 2)
    assert len(killed) == 1 + work_queue.MAX_WORKER_LOSSES
    errors = {cell: str(head.error) for cell, head in results.heads().items() if head.status == "failed"}
    assert set(errors) == {deadly.id, hanging.id}
    assert errors[deadly.id].startswith(f"its worker was lost {work_queue.MAX_WORKER_LOSSES} times, at last: ")
    assert errors[hanging.id] == "it took longer than its time limit of 8 s"
    _, tally = sweep(tmp_path, replace(LOCAL, retry_failed=True))
    assert (tally.ran, tally.failed) == (2, 0)
    assert_same(tmp_path, finished)


def test_a_killed_worker_costs_nothing(finished: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    killed: list[int] = []

    def kill_first(pack: Pack, pid: int) -> None:
        if not killed:
            killed.append(pid)
            os.kill(pid, signal.SIGKILL)

    on_start(monkeypatch, kill_first)
    _, tally = sweep(tmp_path, POOL)
    assert killed
    assert (tally.ran, tally.failed) == (CELLS, 0)
    assert_same(tmp_path, finished)


def test_a_cell_that_kills_its_workers_fails_alone_and_can_be_tried_again(
    finished: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    bad = victim(finished)

    def kill(pack: Pack, pid: int) -> None:
        if bad in pack.cells:
            os.kill(pid, signal.SIGKILL)

    with monkeypatch.context() as patch:
        on_start(patch, kill)
        results, tally = sweep(tmp_path, POOL)
    assert (tally.ran, tally.failed) == (CELLS, 1)
    head = results.heads()[bad.id]
    assert head.status == "failed"
    assert str(head.error).startswith(f"its worker was lost {work_queue.MAX_WORKER_LOSSES} times, at last: ")
    _, tally = sweep(tmp_path, LOCAL)
    assert tally.ran == 0
    _, tally = sweep(tmp_path, replace(LOCAL, retry_failed=True))
    assert (tally.ran, tally.failed) == (1, 0)
    assert_same(tmp_path, finished)


def test_a_cell_that_hangs_is_ended_at_its_time_limit_and_the_rest_of_its_pack_runs(
    finished: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    bad = victim(finished)

    def stop(pack: Pack, pid: int) -> None:
        if bad in pack.cells:
            os.kill(pid, signal.SIGSTOP)

    with monkeypatch.context() as patch:
        on_start(patch, stop)
        results, tally = sweep(tmp_path, replace(POOL, time_limit=8))
    assert (tally.ran, tally.failed) == (CELLS, 1)
    assert results.heads()[bad.id].error == "it took longer than its time limit of 8 s"
    _, tally = sweep(tmp_path, replace(LOCAL, retry_failed=True))
    assert (tally.ran, tally.failed) == (1, 0)
    assert_same(tmp_path, finished)


def test_a_cell_that_is_too_slow_fails_at_its_time_limit(tmp_path: Path) -> None:
    slow = {"episodes": [10**7], "evaluate_every": [10**7]}
    _, tally = sweep(
        tmp_path, replace(POOL, time_limit=1), seeds=1, agents={"q_learning": {}}, hyperparameters=slow, **EXACT
    )
    assert (tally.ran, tally.failed) == (2, 2)


EXACT = {
    "scenarios": [
        {
            "source": {"task": "windy_gridworld", "kinds": ["exact"]},
            "targets": ["windy_gridworld:wind=small", "windy_gridworld:wind=reversed"],
        }
    ]
}


def test_a_cell_whose_arrays_do_not_fit_into_memory_fails_with_that_cause(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def replay(capacity: int, *rest: Any) -> Replay:
        return Replay(10**13 if capacity == 777 else capacity, *rest)

    monkeypatch.setattr(dqn, "Replay", replay)
    deep = {"source": {"task": "cartpole", "agent": "dqn"}, "targets": ["cartpole:gravity=5x"]}
    results, tally = sweep(
        tmp_path,
        scenarios=[deep],
        seeds=1,
        agents={"dqn": {"replay_capacity": [777]}},
        hyperparameters={"episodes": [2]},
    )
    assert (tally.ran, tally.failed) == (2, 1)
    errors = [str(head.error) for head in results.heads().values() if head.status == "failed"]
    assert "Memory" in errors[0]


ONE_LOSS = ("-c", f"from orchestrator.execution import work_queue; work_queue.MAX_WORKER_LOSSES = 1; {DRAWN_SMALL[1]}")
"""A driver that gives a cell one worker."""


@pytest.mark.slow
@pytest.mark.ray
def test_a_node_that_is_out_of_memory_is_said_to_be_so(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("RAY_memory_usage_threshold", "0.01")
    monkeypatch.setenv("RAY_memory_monitor_refresh_ms", "50")
    slow = {"episodes": [10**6], "evaluate_every": [10**6]}
    words = ("--no-mlflow", "--workers", "1", "--seeds", "1", "--tasks", "windy_gridworld:wind=small")
    with driver(tmp_path, *words, python=ONE_LOSS, agents={"q_learning": {}}, hyperparameters=slow, **EXACT) as process:
        out, _ = process.communicate(timeout=200)
    assert process.returncode == 1
    assert "a worker was lost: its node ran out of memory" in out
    heads = Results.open(tmp_path, "small").heads()
    assert [head.status for head in heads.values()] == ["failed"]
