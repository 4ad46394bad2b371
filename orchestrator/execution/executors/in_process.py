"""The executor that runs cells in this process, one after the other."""

from __future__ import annotations

import itertools
import os
import platform
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path

from rich.console import Console

from orchestrator.execution.executors.executor import StageRun, Workplace
from orchestrator.execution.executors.monitor import StageMonitor
from orchestrator.execution.interrupt import Interrupt
from orchestrator.execution.settings import Settings
from orchestrator.execution.work_queue import Pack
from trainables.numerics.threads import one_thread
from trainables.storage.folders import make_folder
from trainables.training.messages import Reached, Report, Started, WorkerPayload
from trainables.training.worker import run_pack


class InProcessExecutor:
    """Runs one pack at a time. A cell over its time limit ends at its next evaluation."""

    def __init__(self, settings: Settings) -> None:
        pass

    def open(self, checkpoints: Path, console: Console, stack: ExitStack) -> Workplace:
        """Return a workplace of one worker: this process, limited to one thread like every worker."""
        one_thread()
        return Workplace(workers=1, at_once=1, checkpoints=make_folder(checkpoints))

    def run(self, stages: Iterator[StageRun]) -> None:
        """Run the packs of each stage's queue."""
        for stage in stages:
            _Stage(stage.monitor, stage.payload).run()


class _Unwound(Exception):  # noqa: N818
    """Ends a pack between two evaluations, by early stopping or at its time limit."""


class _EndedNow(BaseException):
    """Ends the stage at once, in the middle of a cell: the second Ctrl-C."""


class _Stage:
    def __init__(self, monitor: StageMonitor, payload: WorkerPayload) -> None:
        self._monitor, self._payload = monitor, payload
        self._trial = ""
        self._telling = self._at_once = False
        self._interrupt = Interrupt(self._end_now)

    def run(self) -> None:
        with self._interrupt:
            try:
                for number in itertools.count():
                    self._trial = str(number)
                    if (pack := self._monitor.next(self._trial)) is None:
                        return
                    self._run(pack)
            except _EndedNow:
                self._monitor.queue.stopping = True
                self._monitor.on_completed(self._trial)

    def _run(self, pack: Pack) -> None:
        self._tell(Started(os.getpid(), platform.node()))
        try:
            run_pack(pack.cells, pack.together, self._payload, self._tell, self._stop)
        except _Unwound:
            if self._monitor.queue.running[self._trial].killed:
                self._monitor.on_lost(self._trial, "its time limit")
        self._monitor.on_completed(self._trial)

    def _tell(self, report: Report) -> None:
        """Pass on a report; an interrupt waits until its outcomes are on disk."""
        self._telling = True
        try:
            self._monitor.on_report(self._trial, report)
            ended = isinstance(report, Reached) and self._monitor.stops(self._trial, report.evaluations, report.score)
        finally:
            self._telling = False
        if self._at_once:
            raise _EndedNow
        if ended:
            raise _Unwound

    def _stop(self) -> bool:
        if self._interrupt.requested:
            self._monitor.queue.stopping = True
            return True
        if self._monitor.overdue():
            raise _Unwound
        return False

    def _end_now(self) -> None:
        self._at_once = True
        if not self._telling:
            raise _EndedNow
