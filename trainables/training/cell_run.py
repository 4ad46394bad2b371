"""Runs one cell from its first evaluation, or its last checkpoint, to its end, without Ray."""

from __future__ import annotations

import logging
import math
import time
from collections.abc import Callable, Container
from dataclasses import replace
from pathlib import Path
from typing import Any, TypedDict, Unpack

from trainables import curve
from trainables.cell import Cell
from trainables.curve import EvalPoint
from trainables.knowledge import Knowledge
from trainables.plugins.loader import describe_error
from trainables.storage import checkpoint
from trainables.training.end_states import EndStates
from trainables.training.messages import Outcome
from trainables.training.train import Training, train

OnPoint = Callable[[EvalPoint], None]
GiveSource = Callable[[Cell], Knowledge | None]
"""Returns the knowledge of a cell's sources."""

log = logging.getLogger("deltatune.training")


class RunOptions(TypedDict, total=False):
    """What a run of a cell keeps, and what it continues from. None of it changes a bit of the result."""

    keep: bool
    """Whether the outcome includes the knowledge; default: no."""
    checkpoints: Path | None
    """A folder for the cell's state, from which a later run continues bit for bit; None: no checkpoints."""
    checkpoint_seconds: float
    """Time between two checkpoints; default: one is written only where the run stops."""
    saved: Container[str] | None
    """The ids of cells with a checkpoint; None: unknown."""
    ends: EndStates | None
    """End states of cells, from which longer ones continue; None: none."""


class CellRun:
    """Runs a cell evaluation by evaluation; an exception makes it a failed cell."""

    def __init__(self, cell: Cell, source: GiveSource, **options: Unpack[RunOptions]) -> None:
        self.cell, self.error = cell, ""
        self.ended = False
        checkpoints, saved, ends = options.get("checkpoints"), options.get("saved"), options.get("ends")
        self._ends, self._continued = ends, 0
        self._keep, self._every = options.get("keep", False), options.get("checkpoint_seconds", math.inf)
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
                resumed = (saved is None or cell.id in saved) and self._resume(self._path, knowledge)
                if not resumed and ends is not None:
                    self._continue(ends, knowledge)

    @property
    def evaluations(self) -> int:
        """Return the number of evaluations so far, those before the last checkpoint included."""
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
                self._keep_end()
                return None
            self._points.append(point)
            if time.perf_counter() - self._saved >= self._every:
                self.save()
        return point

    def save(self) -> None:
        """Save a checkpoint. Best effort: an error, such as a full disk, is logged and does not end the cell."""
        if self._path is None or self._training is None or not self._points:
            return
        try:
            checkpoint.save(self._path, self._state())
        except Exception as error:
            if not self._unsaved:
                log.warning("no checkpoint of %s: %s", _named(self.cell), describe_error(error))
            self._unsaved = True
        self._saved = time.perf_counter()

    def points(self, start: int = 0) -> dict[str, Any]:
        """Return the evaluation curve so far, from evaluation `start` on, as columns."""
        before = len(self._before["episode"])
        if start >= before:
            return curve.columns(self._points[start - before :])
        return curve.joined(
            {name: values[start:] for name, values in self._before.items()}, curve.columns(self._points)
        )

    def returns(self) -> list[float]:
        """Return the greedy returns so far."""
        return [*self._before["greedy_return"], *(point.greedy_return for point in self._points)]

    def outcome(self) -> Outcome:
        """Return the cell's outcome."""
        knowledge: bytes | None = None
        if self._keep and not self.error and self._training is not None:
            with self._caught():
                knowledge = self._training.knowledge().to_bytes()
        table, earlier = self.points(), self._before["seconds"]
        seconds = time.perf_counter() - self._started if self.error else table["seconds"][-1]
        return replace(
            Outcome.of(self.cell, self.error, table, seconds),
            knowledge=knowledge,
            continued=self._continued,
            earlier_seconds=earlier[-1] if earlier and not self.error else 0.0,
        )

    def close(self) -> None:
        """Close the learner; an error is only logged, since the cell has ended."""
        if self._training is not None:
            try:
                self._training.close()
            except Exception as error:
                log.warning("%s could not be closed: %s", _named(self.cell), describe_error(error))

    def _state(self) -> dict[str, Any]:
        assert self._training is not None
        return {"training": self._training.state(), "points": self.points()}

    def _keep_end(self) -> None:
        """Keep the end state. Best effort, as `save`."""
        if self._ends is None or self._path is None:
            return
        try:
            seconds = self._points[-1].seconds if self._points else self._before["seconds"][-1]
            self._ends.keep(self.cell, seconds, self._state)
        except Exception as error:
            log.warning("no end state of %s: %s", _named(self.cell), describe_error(error))

    def _continue(self, ends: EndStates, knowledge: Knowledge | None) -> None:
        """Continue the longest shorter cell of which there is an end state, if there is one."""
        path = ends.shorter(self.cell)
        if path is None:
            return
        if self._resume(path, knowledge):
            self._continued = int(self._before["episode"][-1])
        else:
            log.warning("%s starts anew: the end state %s is missing or unusable", _named(self.cell), path)

    def _resume(self, path: Path, knowledge: Knowledge | None) -> bool:
        """Continue from a saved state; return False where there is none, or it is unusable: the cell starts again."""
        assert self._training is not None
        try:
            state = checkpoint.load_if_whole(path)
            if state is None:
                return False
            before = curve.checked(state["points"])
            self._training.restore(state["training"])
            self._before = before
        except Exception as error:
            log.warning("%s starts again, its checkpoint is unusable: %s", _named(self.cell), describe_error(error))
            self._training.close()
            self._training = train(self.cell, knowledge)  # the old one may be partly restored
            return False
        return True

    def _caught(self) -> _Caught:
        return _Caught(self)


class _Caught:
    """Turns an exception into the failure of a cell, with the cause in a sentence."""

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
    on_point: OnPoint = lambda point: None,
    stop: Callable[[], bool] = lambda: False,
    **options: Unpack[RunOptions],
) -> Outcome | None:
    """Run a cell to its end (see `CellRun`), calling `on_point` with each evaluation, and return its outcome.

    stop: called after each evaluation; if it returns True, the cell is checkpointed, and the result is None.
    """
    run = CellRun(cell, source, **options)
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
