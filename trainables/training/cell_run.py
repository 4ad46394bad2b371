"""Running one cell from its first evaluation, or its last checkpoint, to its end: what a worker does, without Ray."""

from __future__ import annotations

import contextlib
import time
from collections.abc import Callable, Container
from pathlib import Path
from typing import Any

from trainables import curve
from trainables.cell import Cell
from trainables.curve import EvalPoint
from trainables.knowledge import Knowledge
from trainables.plugins.loader import in_words
from trainables.storage import checkpoint
from trainables.training.train import Training, train

Outcome = dict[str, Any]
OnPoint = Callable[[EvalPoint], None]
GiveSource = Callable[[Cell], Knowledge | None]
"""Gives the knowledge that a cell's source names."""


class CellRun:
    """A cell at work, evaluation by evaluation; an exception ends it as a failure, which is an outcome too.

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
        self._started = self._saved = time.perf_counter()
        with self._caught():
            self._training = train(cell, source(cell))
            if checkpoints is not None and self._training.resumable:
                self._path = checkpoints / f"{cell.id}.checkpoint"
                if saved is None or cell.id in saved:
                    self._before = _resume(self._training, self._path)

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
        """Save a checkpoint; a disk that is full, or a storage that is away, costs the checkpoint, not the cell."""
        if self._path is None or self._training is None or not self._points:
            return
        state = {"training": self._training.state(), "points": self.points()}
        with contextlib.suppress(Exception):
            checkpoint.save(self._path, state)
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
        """What came of the cell: {cell, status, error, points, digest, seconds, knowledge}."""
        knowledge: bytes | None = None
        if self._keep and not self.error and self._training is not None:
            with self._caught():
                knowledge = self._training.knowledge().to_bytes()
        table = self.points()
        seconds = time.perf_counter() - self._started if self.error else table["seconds"][-1]
        return _outcome(self.cell, self.error, table, seconds) | {"knowledge": knowledge}

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
        self._run.error = in_words(error)
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
    while (point := run.step()) is not None:
        on_point(point)
        if stop():
            run.save()
            return None
    return run.outcome()


def lost(cell: Cell, error: str, seconds: float) -> Outcome:
    """The outcome of a cell whose worker cannot tell it any more."""
    return _outcome(cell, error, curve.columns([]), seconds) | {"knowledge": None}


def stopped(cell: Cell, reason: str, points: dict[str, Any]) -> Outcome:
    """The outcome of a cell that a scheduler has ended early, with the curve up to there."""
    return _outcome(cell, reason, points, points["seconds"][-1]) | {"status": "stopped", "knowledge": None}


def _outcome(cell: Cell, error: str, points: dict[str, Any], seconds: float) -> Outcome:
    return {
        "cell": cell.to_json(),
        "status": "failed" if error else "done",
        "error": error or None,
        "points": points,
        "digest": curve.digest(points),
        "seconds": seconds,
    }


def _resume(training: Training, path: Path) -> dict[str, Any]:
    """Bring the training to its last checkpoint, if it has one; the points up to there."""
    state = checkpoint.load_if_whole(path)
    if state is None:
        return curve.columns([])
    training.restore(state["training"])
    points: dict[str, Any] = state["points"]
    return points
