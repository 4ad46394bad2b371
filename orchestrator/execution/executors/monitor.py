"""The monitor of a stage: passes the reports of its trials to the queue, the records and the display."""

from __future__ import annotations

import logging
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from orchestrator.execution.cells.ledger import Ledger
from orchestrator.execution.display import Display
from orchestrator.execution.executors.early_stopping import EarlyStopping
from orchestrator.execution.settings import OnRecord, RunSummary
from orchestrator.execution.work_queue import Pack, Running, WorkQueue
from trainables import curve
from trainables.training.messages import (
    Compiling,
    Ended,
    Logged,
    Outcome,
    Progress,
    Reached,
    Report,
    Started,
    lost,
    stopped,
)

log = logging.getLogger("deltatune.workers")


@dataclass
class OutcomeSink:
    """Persists each outcome, then updates summary, display and tracker."""

    stage: str
    ledger: Ledger
    summary: RunSummary
    display: Display
    on_record: OnRecord
    failure: OSError | None = None
    """Why a record could not be written."""

    def take(self, outcomes: list[Outcome]) -> None:
        """Persist outcomes. An OSError ends the sweep, since results could no longer be kept."""
        try:
            records = self.ledger.take(self.stage, outcomes)
        except OSError as error:
            self.failure = error
            raise
        by_cell = {outcome.cell.id: outcome for outcome in outcomes}
        for record in records:
            outcome = by_cell[record.cell.id]
            self.summary.ended(record, outcome.continued > 0, outcome.earlier_seconds)
            self.display.ended(record)
            self.on_record(self.stage, record)


class StageMonitor:
    """Receives the events of trials from an executor."""

    def __init__(
        self,
        queue: WorkQueue,
        sink: OutcomeSink,
        display: Display,
        stopping: EarlyStopping | None,
        workers: set[tuple[int, str]],
    ) -> None:
        """workers: process and node of each worker that has started in the sweep so far; new ones are added."""
        self.queue = queue
        self.display = display
        self._sink, self._stopping = sink, stopping
        self._points: dict[str, Mapping[str, Any]] = {}
        self.workers = workers

    def next(self, trial: str) -> Pack | None:
        """Return the pack of a new trial, or None: none now, or no more (see `WorkQueue.over`)."""
        pack = self.queue.next(trial)
        self.display.running(len(self.queue.running))
        return pack

    def stops(self, trial: str, evaluations: int, score: float) -> bool:
        """Return whether early stopping ends a trial whose cells have all reached an evaluation."""
        running = self.queue.running.get(trial)
        if self._stopping is None or running is None or not running.pack.together:
            return False
        return self._stopping.stops(trial, running.pack.cells, evaluations, score)

    def on_report(self, trial: str, report: Report) -> None:
        """Process a report."""
        match report:
            case Started():
                if (report.pid, report.node) not in self.workers:
                    self.workers.add((report.pid, report.node))
                    log.info("a worker has started: process %d on %s", report.pid, report.node)
                self.queue.on_started(trial, report.pid, report.node)
            case Compiling():
                self.display.compiling()
            case Progress():
                self.display.progress(report)
                self.queue.on_progress(report.cell, report.share)
            case Reached():
                for cell_id, points in report.points:
                    self._points[cell_id] = curve.joined(self._points.get(cell_id, {}), points)
            case Logged():
                for name, level, text in report.lines:
                    logging.getLogger(name).log(level, "%s", text)
            case Ended():
                self.queue.on_outcomes(trial, report.outcomes)
                self._sink.take(list(report.outcomes))

    def on_completed(self, trial: str) -> None:
        """Note that a trial has ended by itself, or by early stopping."""
        reason = self._stopping.stopped.get(trial) if self._stopping else None
        cells = running.pack.cells if (running := self.queue.running.get(trial)) else ()
        curves = {cell.id: dict(self._points.pop(cell.id)) for cell in cells if cell.id in self._points}
        if reason:
            self._sink.take([stopped(cell, reason, curves[cell.id]) for cell in cells if cell.id in curves])
        self.queue.on_completed(trial)
        self.display.running(len(self.queue.running))

    def on_lost(self, trial: str, why: str) -> None:
        """Note that a trial's worker is gone."""
        running = self.queue.running.get(trial)
        if running is None:
            return
        if not running.killed:
            log.warning("a worker was lost: %s", why)
        for cell in running.pack.cells:
            self.display.over(cell.id)
            self._points.pop(cell.id, None)
        if failures := self.queue.on_lost(trial, why):
            self._sink.take([lost(failure.cell, failure.error, failure.seconds) for failure in failures])
        self.display.running(len(self.queue.running))

    def overdue(self) -> list[Running]:
        """Return the packs over their time limit, each once; the executor must end their workers."""
        return self.queue.overdue()
