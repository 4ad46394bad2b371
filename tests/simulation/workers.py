"""Workers that train nothing: every cell has a known result, which comes late, twice, out of order, or never."""

from __future__ import annotations

import heapq
import itertools
from collections.abc import Iterator
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path

import numpy as np
from rich.console import Console

from orchestrator.execution.executors.executor import StageRun, Workplace
from orchestrator.execution.executors.monitor import StageMonitor
from orchestrator.execution.settings import Settings
from orchestrator.execution.work_queue import Pack
from tests.simulation.world import StuckError, World
from trainables import curve
from trainables.cell import Cell
from trainables.knowledge import Knowledge
from trainables.storage.folders import make_folder
from trainables.training.messages import Ended, Outcome, Progress, Report, Started, WorkerPayload

WORKERS = 3
TIME_LIMIT = 100.0
"""Seconds that a cell may take; those that do not hang take less."""

MAX_LOSSES = 2
"""Losses of a healthy cell's worker in one life of a driver: one more, and it would fail."""


_known: dict[tuple[str, bool], Outcome] = {}


def known(cell: Cell, keep: bool) -> Outcome:
    """What comes of a cell, whoever runs it."""
    if (cell.id, keep) not in _known:
        _known[cell.id, keep] = _outcome(cell, keep)
    return _known[cell.id, keep]


def _outcome(cell: Cell, keep: bool) -> Outcome:
    number = int(cell.id[:6], 16)
    points = {name: [0, 1, 2] for name in curve.FIELDS} | {"greedy_return": [0.0, number / 7, -number / 3]}
    if number % 7 == 3:
        return Outcome.of(cell, f"ValueError: known failure {number}", points, 1.0)
    table = np.full((400, 4), number / 7)
    outcome = Outcome.of(cell, "", points, 1.0)
    return replace(outcome, knowledge=Knowledge({"q": table}).to_bytes() if keep else None)


class Workers:
    """The executor of one driver."""

    world: World

    def __init__(self, settings: Settings) -> None:
        self._losses: dict[str, int] = {}
        self._number = itertools.count()

    def open(self, checkpoints: Path, console: Console, stack: ExitStack) -> Workplace:
        return Workplace(WORKERS, WORKERS, make_folder(checkpoints))

    def run(self, stages: Iterator[StageRun]) -> None:
        for stage in stages:
            self._run(stage.monitor, stage.payload)

    def _run(self, monitor: StageMonitor, payload: WorkerPayload) -> None:
        """Hand out, and tell what comes of it in the order of virtual time."""
        world, queue = self.world, monitor.queue
        driver = world.driver
        assert driver is not None
        events: list[tuple[float, int, str, Report | str]] = []
        while True:
            queue.stopping = queue.stopping or driver.requested
            while (pack := monitor.next(trial := str(next(self._number)))) is not None:
                self._start(trial, pack, payload.keep, events)
            if not queue.running:
                if not queue.over():
                    raise StuckError("cells are left, and none is handed out")
                return
            at, _, trial, report = heapq.heappop(events)
            world.pause(max(at - world.now, 0.0))
            world.step()
            self._tell(monitor, trial, report)
            for late in monitor.overdue():
                lost = next(name for name, running in queue.running.items() if running is late)
                monitor.on_lost(lost, "it was ended")
            if report == "tick" and queue.running:
                heapq.heappush(events, (world.now + 25.0, next(self._number), trial, "tick"))

    def _tell(self, monitor: StageMonitor, trial: str, report: Report | str) -> None:
        if report == "lost":
            monitor.on_lost(trial, "its node is gone")
        elif report == "completed":
            monitor.on_completed(trial)
        elif not isinstance(report, str):
            monitor.on_report(trial, report)

    def _start(self, trial: str, pack: Pack, keep: bool, events: list[tuple[float, int, str, Report | str]]) -> None:
        """Settle what will come of a pack."""
        world, rng = self.world, self.world.random
        at = world.now + rng.uniform(0.1, 2.0)
        assert world.driver is not None
        told: list[tuple[float, Report | str]] = [(at, Started(1000 + int(trial), "node"))]
        for cell in pack.cells:
            if world.kept.get(cell.id) == "done" and not world.lied:
                world.violated(f"the cell {cell.id} runs again, though it was recorded as done")
            share = rng.uniform(0.5, 30.0)
            told.append((at + share / 2, Progress(cell.id, 0.5, 1, 0.0)))
            at += share
            told.append((at, Ended((known(cell, keep),))))
        told.append((at + 0.1, "completed"))
        for time, report in self._harmed(pack, told):
            heapq.heappush(events, (time, next(self._number), trial, report))
        heapq.heappush(events, (world.now + 25.0, next(self._number), trial, "tick"))

    def _harmed(self, pack: Pack, told: list[tuple[float, Report | str]]) -> list[tuple[float, Report | str]]:
        world, rng = self.world, self.world.random
        *told, completed = told  # which no executor tells before what its trial has told
        if world.chance("out of order"):
            times = [at for at, _ in told]
            rng.shuffle(times)
            told = [(at, report) for at, (_, report) in zip(times, told, strict=True)]
        double = world.chance("double outcome")
        told += [(at + rng.uniform(0, 40), report) for at, report in told if double and isinstance(report, Ended)]
        told.append(completed)
        spared = any(self._losses.get(cell.id, 0) >= MAX_LOSSES for cell in pack.cells)
        if not spared and world.chance("lost worker"):
            for cell in pack.cells:
                self._losses[cell.id] = self._losses.get(cell.id, 0) + 1
            cut = rng.choice(told)[0]
            rest = [(at + rng.uniform(0, 60), report) for at, report in told if at >= cut and report != "completed"]
            told = [*(each for each in told if each[0] < cut), (cut, "lost")]
            told += rest if world.chance("late outcome") else []
        elif world.chance("hung worker"):
            told = told[: rng.randrange(1, len(told))]
            told = [each for each in told if each[1] != "completed"]
        return told
