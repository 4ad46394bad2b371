"""The queue: every cell is handed out until it has ended, whatever becomes of its workers."""

from __future__ import annotations

import random
from collections.abc import Sequence

import pytest
from hypothesis import given
from hypothesis import strategies as st

from orchestrator import clock
from orchestrator.execution.work_queue import FIRST_GUESS, MAX_PACK_SIZE, MAX_WORKER_LOSSES, CellStatus, Pack, WorkQueue
from trainables import curve
from trainables.cell import Cell
from trainables.training.messages import Outcome

CELLS = [Cell.create("q_learning", "windy_gridworld", seed, {"episodes": 10}) for seed in range(40)]


class Book:
    """What has become of cells."""

    def __init__(self) -> None:
        self.done: list[str] = []
        self.failed: dict[str, str] = {}

    def queue(self, cells: Sequence[Cell], at_once: int | None = 2, time_limit: float | None = None) -> WorkQueue:
        ended = CellStatus(lambda cell: cell.id in self.done or cell.id in self.failed, lambda cells: None)
        return WorkQueue(ended, at_once, list(cells), time_limit=time_limit)

    def end(self, queue: WorkQueue, trial: str, cells: Sequence[Cell], seconds: float = 0.01) -> None:
        self.done += [cell.id for cell in cells]
        queue.on_outcomes(trial, [Outcome.of(cell, "", curve.columns([]), seconds) for cell in cells])

    def lose(self, queue: WorkQueue, trial: str, why: str) -> None:
        self.failed |= {failure.cell.id: failure.error for failure in queue.on_lost(trial, why)}


@given(seed=st.integers(0, 10**6), loss=st.floats(0, 0.6), at_once=st.sampled_from([1, 2, 7, None]))
def test_whatever_is_lost_every_cell_ends_exactly_once(seed: int, loss: float, at_once: int | None) -> None:
    rng, book = random.Random(seed), Book()
    queue = book.queue(CELLS, at_once)
    trials, number = {}, 0
    while not queue.over():
        while len(trials) < 9 and (pack := queue.next(str(number))) is not None:
            trials[str(number)] = pack
            queue.on_started(str(number), 1, "node")
            number += 1
        assert at_once is None or len(queue.running) <= at_once
        trial, pack = trials.popitem()
        if rng.random() < loss:
            book.end(queue, trial, pack.cells[: rng.randrange(len(pack.cells))])
            book.lose(queue, trial, "gone")
        else:
            book.end(queue, trial, pack.cells)
            queue.on_completed(trial)
    assert sorted([*book.done, *book.failed]) == sorted(cell.id for cell in CELLS)


def test_the_cell_that_kills_its_workers_is_found_among_its_pack() -> None:
    book = Book()
    queue, bad = book.queue(CELLS[:8]), CELLS[5]
    number = 0
    while not queue.over():
        pack = queue.next(str(number))
        assert pack is not None
        if bad in pack.cells:
            book.lose(queue, str(number), "boom")
        else:
            book.end(queue, str(number), pack.cells)
            queue.on_completed(str(number))
        number += 1
    assert book.failed == {bad.id: f"its worker was lost {MAX_WORKER_LOSSES} times, at last: boom"}


def test_packs_grow_to_their_target_and_no_further() -> None:
    book = Book()
    queue = book.queue([*CELLS * 100], at_once=2)
    sizes = []
    for number in range(4):
        pack = queue.next(str(number))
        assert pack is not None
        sizes.append(len(pack.cells))
        queue.on_outcomes(str(number), [Outcome.of(cell, "", curve.columns([]), 0.001) for cell in pack.cells])
        queue.on_completed(str(number))
    assert sizes[0] == FIRST_GUESS
    assert sizes[1:] == [MAX_PACK_SIZE] * 3


def test_long_cells_go_alone() -> None:
    cells = [Cell.create("dqn", "cartpole", seed, {"episodes": 10}) for seed in range(3)]
    pack = Book().queue(cells).next("a")
    assert pack is not None
    assert len(pack.cells) == 1


def test_a_cell_that_gets_further_each_time_never_fails_for_its_nodes() -> None:
    book = Book()
    queue = book.queue(CELLS[:1])
    for number in range(3 * MAX_WORKER_LOSSES):
        assert queue.next(str(number)) is not None
        queue.on_progress(CELLS[0].id, 0.1 * (number + 1))
        book.lose(queue, str(number), "the spot machine is gone")
    assert not book.failed
    for number in range(MAX_WORKER_LOSSES - 1):
        assert queue.next(f"again{number}") is not None
        queue.on_progress(CELLS[0].id, 0.2)
        book.lose(queue, f"again{number}", "boom")
    assert list(book.failed) == [CELLS[0].id]


def test_only_what_takes_too_long_is_overdue_and_only_once(monkeypatch: pytest.MonkeyPatch) -> None:
    now = [100.0]
    monkeypatch.setattr(clock, "monotonic", lambda: now[0])
    book = Book()
    queue = book.queue(CELLS[:2], time_limit=10)
    assert queue.next("a")
    now[0] += 1000
    assert queue.overdue() == [], "its worker has not begun"
    queue.on_started("a", 1, "node")
    now[0] += 9
    assert queue.overdue() == []
    now[0] += 3
    assert [running.pack for running in queue.overdue()] == [queue.running["a"].pack]
    assert queue.overdue() == []
    book.lose(queue, "a", "killed")
    assert list(book.failed.values()) == ["it took longer than its time limit of 10 s"]


def test_a_queue_that_stops_hands_nothing_out() -> None:
    queue = Book().queue(CELLS)
    assert isinstance(queue.next("a"), Pack)
    queue.stopping = True
    assert queue.next("b") is None
    assert not queue.over()
    queue.on_completed("a")
    assert queue.over()
