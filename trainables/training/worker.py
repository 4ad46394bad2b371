"""What a worker does with the cells that it is handed, and what it reports meanwhile: without Ray.

An executor of the orchestrator calls `run_pack`: in its own process, in another one, or as a Ray Tune trial.
"""

from __future__ import annotations

import contextlib
import logging
import math
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from trainables.cell import Cell
from trainables.curve import EvalPoint
from trainables.knowledge import Knowledge
from trainables.storage.paths import is_local, storage_path
from trainables.training.cell_run import CellRun, GiveSource, Outcome, run_cell
from trainables.training.lockstep import lockstep

PROGRESS_SECONDS = 2.0
"""Time between reports of a long cell's progress."""

OUTCOME_SECONDS = 1.0
"""Time between reports of ended cells, and between two looks for the driver's wish to stop on a disk."""

REMOTE_LOOK_SECONDS = 5.0
"""Time between two looks on an object store, where each of each worker is a request that is paid for."""

STOP = "STOP"
"""The file in the checkpoints' folder by which the driver asks its workers to stop."""

LOGGER = "deltatune"
"""The logger of the whole product; each package has one below it."""

log = logging.getLogger("deltatune.worker")


@dataclass(frozen=True)
class WorkerPayload:
    """Constant arguments shipped to every worker of a stage."""

    sources: Mapping[str, Mapping[str, Any]]
    """The arrays of each source, by `Cell.source_key`."""
    keep: bool
    """Whether what each cell has learned is wanted."""
    checkpoints: str | None
    """The folder for the states of long cells; None: a lost worker costs its cell's work."""
    checkpoint_seconds: float
    """Time between two checkpoints of a cell."""
    plugins: Mapping[str, bytes]
    """The user's files that the driver has loaded (`plugins.loader.packed`)."""


@dataclass(frozen=True)
class Started:
    """A worker has begun with its cells."""

    pid: int
    node: str


@dataclass(frozen=True)
class Progress:
    """How far a long cell is."""

    cell: str
    share: float
    """Of its episodes: 0 to 1."""
    step: int
    greedy_return: float


@dataclass(frozen=True)
class Ended:
    """Cells that have ended."""

    outcomes: tuple[Outcome, ...]


@dataclass(frozen=True)
class Reached:
    """The cells of a configuration have reached an evaluation together: early stopping judges by it."""

    evaluations: int
    score: float
    points: tuple[tuple[str, dict[str, Any]], ...]
    """Cell id and the part of its curve that is new since the last report."""


@dataclass(frozen=True)
class Logged:
    """What a worker has to say: (logger, level, text)."""

    lines: tuple[tuple[str, int, str], ...]


Report = Started | Progress | Ended | Reached | Logged
Tell = Callable[[Report], None]
"""Hands a report to the driver."""
Stop = Callable[[], bool]
"""Whether the driver has asked to stop."""


def run_pack(cells: Sequence[Cell], together: bool, payload: WorkerPayload, tell: Tell, stop: Stop) -> None:
    """Run cells one after the other, telling what becomes of each. A cell that fails is an outcome like another.

    together: run them side by side, and tell after each evaluation, for early stopping to judge.
    """
    folder = storage_path(payload.checkpoints) if payload.checkpoints else None
    options: dict[str, Any] = {
        "keep": payload.keep,
        "checkpoints": folder,
        "checkpoint_seconds": payload.checkpoint_seconds,
        "saved": _saved(folder),
    }

    def source(cell: Cell) -> Knowledge | None:
        return Knowledge(payload.sources[cell.source_key]) if cell.sources else None

    if together:
        _run_together([CellRun(cell, source, **options) for cell in cells], tell, stop)
    else:
        _run_in_turn(cells, source, options, tell, stop)


def _saved(folder: Path | None) -> set[str] | None:
    """The cells that have a checkpoint, asked once for all of a pack's; None where the storage does not say."""
    try:
        return {path.stem for path in folder.glob("*.checkpoint")} if folder else set()
    except Exception as error:
        log.info("cannot list the checkpoints in %s: %s", folder, error)
        return None


def _run_in_turn(cells: Sequence[Cell], source: GiveSource, options: dict[str, Any], tell: Tell, stop: Stop) -> None:
    """One cell after the other; the outcomes of short ones are reported together."""
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
    """The seeds of a configuration in lockstep, as far as early stopping lets them."""
    told = {run.cell.id: 0 for run in runs}
    try:
        for rung in lockstep(runs, stop):
            points = tuple((run.cell.id, run.points(told[run.cell.id])) for run in runs)
            told = {run.cell.id: run.evaluations for run in runs}
            tell(Reached(rung.evaluations, rung.score, points))
        if ended := tuple(run.outcome() for run in runs if run.ended):
            tell(Ended(ended))
    finally:
        for run in runs:
            run.close()


class _ProgressReports:
    """Reports how far a long cell is, every other second."""

    def __init__(self, cell: Cell, tell: Tell) -> None:
        self._cell, self._episodes, self._tell = cell, cell.settings.episodes, tell
        self._reported = time.monotonic()

    def __call__(self, point: EvalPoint) -> None:
        """Report, unless the last report is not long ago."""
        if time.monotonic() - self._reported >= PROGRESS_SECONDS:
            self._reported = time.monotonic()
            self._tell(Progress(self._cell.id, point.episode / self._episodes, point.step, point.greedy_return))


class StopFile:
    """Whether the driver has asked its workers to stop; looked up now and then."""

    def __init__(self, folder: Path | None) -> None:
        self._path = folder / STOP if folder else None
        self._every = OUTCOME_SECONDS if is_local(folder) else REMOTE_LOOK_SECONDS
        self._looked = -math.inf
        self._there = False

    def __call__(self) -> bool:
        """Return whether to stop."""
        if self._path is not None and not self._there and time.monotonic() - self._looked >= self._every:
            self._looked = time.monotonic()
            with contextlib.suppress(Exception):  # a storage out of reach is no reason to stop
                self._there = self._path.exists()
        return self._there


@contextmanager
def forwarded_log(tell: Tell) -> Iterator[Tell]:
    """Send what this process logs to the driver, before each report; give the `tell` that does so."""
    handler = _Collected()
    logger = logging.getLogger(LOGGER)
    logger.addHandler(handler)
    logger.setLevel(logging.INFO)

    def told(report: Report) -> None:
        handler.flush_to(tell)
        tell(report)

    try:
        yield told
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
