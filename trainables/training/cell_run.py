"""Running one cell from its first evaluation, or its last checkpoint, to its end: what a worker does, without Ray."""

from __future__ import annotations

import logging
import time
from collections.abc import Callable, Container
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal

from trainables import curve
from trainables.cell import Cell
from trainables.curve import EvalPoint
from trainables.knowledge import Knowledge
from trainables.plugins.loader import describe_error
from trainables.storage import checkpoint
from trainables.training.train import Training, train

OnPoint = Callable[[EvalPoint], None]
GiveSource = Callable[[Cell], Knowledge | None]
"""Gives the knowledge that a cell's source names."""

log = logging.getLogger("deltatune.training")


@dataclass(frozen=True)
class Outcome:
    """What became of a cell."""

    cell: Cell
    status: Literal["done", "failed", "stopped"]
    error: str | None
    """Why it failed, or was stopped, in a sentence."""
    points: dict[str, list[float | int | None]]
    """The evaluation curve as columns; of a failed or stopped cell, as far as it went."""
    digest: str
    """`curve.digest` of the points."""
    seconds: float
    """Seconds that the cell took."""
    knowledge: bytes | None = None
    """What was learned, where that was wanted."""

    @classmethod
    def of(cls, cell: Cell, error: str, points: Any, seconds: float) -> Outcome:
        """Return the outcome of a cell that is done, or failed where there is an error."""
        return cls(cell, "failed" if error else "done", error or None, points, curve.digest(points), seconds)


class CellRun:
    """Runs a cell evaluation by evaluation; an exception ends it as a failure, which is an outcome too.

    keep: whether what is learned is wanted. checkpoints: a folder for the cell's state, from which a later run goes on
    bit for bit; None: no checkpoints. checkpoint_seconds: time between two of them. saved: the ids of the cells that
    have one; None: look.
    """

    def __init__(
        self,
        cell: Cell,
        source: GiveSource,
        *,
        keep: bool = False,
        checkpoints: Path | None = None,
        checkpoint_seconds: float = 5.0,
        saved: Container[str] | None = None,
    ) -> None:
        self.cell, self.error = cell, ""
        self.ended = False
        self._keep, self._every = keep, checkpoint_seconds
        self._before: dict[str, Any] = curve.columns([])
        self._points: list[EvalPoint] = []
        self._training: Training | None = None
        self._path: Path | None = None
        self._unsaved = False
        self._started = self._saved = time.perf_counter()
        with self._caught():
            knowledge = source(cell)
            self._training = train(cell, knowledge)
            if checkpoints is not None and self._training.resumable:
                self._path = checkpoints / f"{cell.id}.checkpoint"
                if (saved is None or cell.id in saved) and not self._resume(self._path):
                    self._training.close()
                    self._training = train(cell, knowledge)  # the old one may be half restored

    @property
    def evaluations(self) -> int:
        """Evaluations so far, those before the last checkpoint included."""
        return len(self._before["episode"]) + len(self._points)

    def step(self) -> EvalPoint | None:
        """Train up to the next evaluation and return it; None once the cell has ended."""
        if self.ended or self._training is None:
            return None
        point: EvalPoint | None = None
        with self._caught():
            point = next(self._training, None)
            if point is None:
                self.ended = True
                return None
            self._points.append(point)
            if time.perf_counter() - self._saved >= self._every:
                self.save()
        return point

    def save(self) -> None:
        """Save a checkpoint, best effort: what prevents it is logged, and never ends the cell."""
        if self._path is None or self._training is None or not self._points:
            return
        try:
            checkpoint.save(self._path, {"training": self._training.state(), "points": self.points()})
        except Exception as error:
            if not self._unsaved:
                log.warning("no checkpoint of %s: %s", _named(self.cell), describe_error(error))
            self._unsaved = True
        self._saved = time.perf_counter()

    def points(self, start: int = 0) -> dict[str, Any]:
        """The evaluation curve so far, from evaluation `start` on, as columns."""
        before = len(self._before["episode"])
        if start >= before:
            return curve.columns(self._points[start - before :])
        return curve.joined(
            {name: values[start:] for name, values in self._before.items()}, curve.columns(self._points)
        )

    def returns(self) -> list[float]:
        """The greedy returns so far."""
        return [*self._before["greedy_return"], *(point.greedy_return for point in self._points)]

    def outcome(self) -> Outcome:
        """What came of the cell."""
        knowledge: bytes | None = None
        if self._keep and not self.error and self._training is not None:
            with self._caught():
                knowledge = self._training.knowledge().to_bytes()
        table = self.points()
        seconds = time.perf_counter() - self._started if self.error else table["seconds"][-1]
        return replace(Outcome.of(self.cell, self.error, table, seconds), knowledge=knowledge)

    def close(self) -> None:
        """Close what the learner holds open; an error there is logged, for the cell has ended."""
        if self._training is not None:
            try:
                self._training.close()
            except Exception as error:
                log.warning("%s could not be closed: %s", _named(self.cell), describe_error(error))

    def _resume(self, path: Path) -> bool:
        """Go on from the last checkpoint; False where it cannot be used, and the cell has to start anew."""
        assert self._training is not None
        try:
            state = checkpoint.load_if_whole(path)
            if state is not None:
                before = curve.checked(state["points"])
                self._training.restore(state["training"])
                self._before = before
        except Exception as error:
            log.warning("%s starts anew, its checkpoint cannot be used: %s", _named(self.cell), describe_error(error))
            return False
        return True

    def _caught(self) -> _Caught:
        return _Caught(self)


class _Caught:
    """Turns an exception into the end of a cell, with its cause in a sentence."""

    def __init__(self, run: CellRun) -> None:
        self._run = run

    def __enter__(self) -> None:
        pass

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: Any) -> bool:
        if not isinstance(error, Exception):
            return False
        self._run.error = describe_error(error)
        self._run.ended = True
        return True


def run_cell(
    cell: Cell,
    source: GiveSource,
    *,
    keep: bool = False,
    checkpoints: Path | None = None,
    checkpoint_seconds: float = 5.0,
    saved: Container[str] | None = None,
    on_point: OnPoint = lambda point: None,
    stop: Callable[[], bool] = lambda: False,
) -> Outcome | None:
    """Run a cell to its end (see `CellRun`), telling `on_point` of each evaluation of this call.

    stop: is asked after each evaluation; where it says so, the cell is checkpointed and there is no outcome: None.
    """
    run = CellRun(cell, source, keep=keep, checkpoints=checkpoints, checkpoint_seconds=checkpoint_seconds, saved=saved)
    try:
        while (point := run.step()) is not None:
            on_point(point)
            if stop():
                run.save()
                return None
        return run.outcome()
    finally:
        run.close()


def _named(cell: Cell) -> str:
    return f"{cell.agent} on {cell.task}, seed {cell.seed} (cell {cell.id})"


def lost(cell: Cell, error: str, seconds: float) -> Outcome:
    """Return the outcome of a cell whose worker cannot tell it any more."""
    return Outcome.of(cell, error, curve.columns([]), seconds)


def stopped(cell: Cell, reason: str, points: dict[str, Any]) -> Outcome:
    """Return the outcome of a cell that a scheduler has ended early, with the curve up to there."""
    return replace(Outcome.of(cell, reason, points, points["seconds"][-1]), status="stopped")
