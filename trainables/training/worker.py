"""Runs the cells of a pack on a worker, and reports their progress and outcomes, without Ray.

An executor of the orchestrator calls `run_pack`: in its own process, in another one, or as a Ray Tune trial.
"""

from __future__ import annotations

import logging
import math
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

from trainables.cell import Cell
from trainables.curve import EvalPoint
from trainables.knowledge import Knowledge
from trainables.storage.paths import is_local, storage_path
from trainables.training.cell_run import CellRun, GiveSource, RunOptions, run_cell
from trainables.training.lockstep import lockstep
from trainables.training.messages import (
    LOGGER,
    STOP,
    Compiling,
    Ended,
    Logged,
    Outcome,
    Progress,
    Reached,
    Report,
    Stop,
    Tell,
    WorkerPayload,
)

PROGRESS_SECONDS = 2.0
"""Time between reports of a long cell's progress."""

OUTCOME_SECONDS = 1.0
"""Time between reports of ended cells, and between checks of the stop file on a disk."""

REMOTE_LOOK_SECONDS = 5.0
"""Time between checks of the stop file on an object store, where each check of each worker is a paid request."""

log = logging.getLogger("deltatune.worker")


def run_pack(cells: Sequence[Cell], together: bool, payload: WorkerPayload, tell: Tell, stop: Stop) -> None:
    """Run cells one after the other, and report the outcome of each; a failed cell does not affect the others.

    together: run them side by side, with a report after each evaluation, for early stopping.
    """
    from trainables.numerics.jit import on_compilation

    folder = storage_path(payload.checkpoints) if payload.checkpoints else None
    options: RunOptions = {
        "keep": payload.keep,
        "checkpoints": folder,
        "checkpoint_seconds": payload.checkpoint_seconds,
        "saved": _saved(folder),
        "ends": payload.ends,
    }

    def source(cell: Cell) -> Knowledge | None:
        return Knowledge(payload.sources[cell.source_key]) if cell.sources else None

    with on_compilation(lambda: tell(Compiling())):
        if together:
            _run_together([CellRun(cell, source, **options) for cell in cells], tell, stop)
        else:
            _run_in_turn(cells, source, options, tell, stop)


def _saved(folder: Path | None) -> set[str] | None:
    """Return the ids of cells with a checkpoint, from one listing; None where the storage does not answer."""
    try:
        return {path.stem for path in folder.glob("*.checkpoint")} if folder else set()
    except Exception as error:
        log.info("cannot list the checkpoints in %s: %s", folder, error)
        return None


def _run_in_turn(cells: Sequence[Cell], source: GiveSource, options: RunOptions, tell: Tell, stop: Stop) -> None:
    """Run one cell after the other; outcomes of short ones are reported together."""
    outcomes: list[Outcome] = []
    reported = time.monotonic()
    for cell in cells:
        outcome = run_cell(cell, source, **options, on_point=_ProgressReports(cell, tell), stop=stop)
        if outcome is not None:
            outcomes.append(outcome)
        if outcomes and time.monotonic() - reported >= OUTCOME_SECONDS:
            tell(Ended(tuple(outcomes)))
            outcomes, reported = [], time.monotonic()
        if stop():
            break
    if outcomes:
        tell(Ended(tuple(outcomes)))


def _run_together(runs: Sequence[CellRun], tell: Tell, stop: Stop) -> None:
    """Run the seeds of a configuration in lockstep until they end or early stopping ends them."""
    reported = {run.cell.id: 0 for run in runs}
    try:
        for rung in lockstep(runs, stop):
            points = tuple((run.cell.id, run.points(reported[run.cell.id])) for run in runs)
            reported = {run.cell.id: run.evaluations for run in runs}
            tell(Reached(rung.evaluations, rung.score, points))
        if ended := tuple(run.outcome() for run in runs if run.ended):
            tell(Ended(ended))
    finally:
        for run in runs:
            run.close()


class _ProgressReports:
    """Reports the progress of a long cell, every PROGRESS_SECONDS."""

    def __init__(self, cell: Cell, tell: Tell) -> None:
        self._cell, self._episodes, self._tell = cell, cell.episodes, tell
        self._reported = time.monotonic()

    def __call__(self, point: EvalPoint) -> None:
        """Report, unless the last report is too recent."""
        if time.monotonic() - self._reported >= PROGRESS_SECONDS:
            self._reported = time.monotonic()
            self._tell(Progress(self._cell.id, point.episode / self._episodes, point.step, point.greedy_return))


class StopFile:
    """Checks from time to time whether the driver has asked its workers to stop."""

    def __init__(self, folder: Path | None) -> None:
        self._path = folder / STOP if folder else None
        self._every = OUTCOME_SECONDS if is_local(folder) else REMOTE_LOOK_SECONDS
        self._looked = -math.inf
        self._there = False

    def __call__(self) -> bool:
        """Return whether to stop."""
        if self._path is not None and not self._there and time.monotonic() - self._looked >= self._every:
            self._looked = time.monotonic()
            try:
                self._there = self._path.exists()
            except Exception as error:  # an unreachable storage is no reason to stop
                log.info("cannot look for %s: %s", self._path, error)
        return self._there


@contextmanager
def forwarded_log(tell: Tell) -> Iterator[Tell]:
    """Yield a `tell` that sends the log messages of this process to the driver before each report."""
    handler = _Collected()
    logger = logging.getLogger(LOGGER)
    logger.addHandler(handler)
    logger.setLevel(logging.INFO)

    def send(report: Report) -> None:
        handler.flush_to(tell)
        tell(report)

    try:
        yield send
        handler.flush_to(tell)
    finally:
        logger.removeHandler(handler)


class _Collected(logging.Handler):
    def __init__(self) -> None:
        super().__init__(logging.INFO)
        self._lines: list[tuple[str, int, str]] = []

    def emit(self, record: logging.LogRecord) -> None:
        self._lines.append((record.name, record.levelno, record.getMessage()))

    def flush_to(self, tell: Tell) -> None:
        lines, self._lines = tuple(self._lines), []
        if lines:
            tell(Logged(lines))
