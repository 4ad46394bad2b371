"""Running one cell from its first evaluation, or its last checkpoint, to its end: what a worker does, without Ray."""

from __future__ import annotations

import time
import traceback
from collections.abc import Callable
from pathlib import Path
from typing import Any

from trainables import checkpoint, curve
from trainables.cell import Cell
from trainables.evaluation import EvalPoint
from trainables.knowledge import Knowledge
from trainables.training import Training, train

Outcome = dict[str, Any]
OnPoint = Callable[[EvalPoint], None]


def run_cell(
    cell: Cell,
    source: Callable[[Cell], Knowledge | None],
    *,
    keep: bool = False,
    checkpoints: Path | None = None,
    checkpoint_seconds: float = 5.0,
    on_point: OnPoint = lambda point: None,
) -> Outcome:
    """Run a cell to its end: {cell, status, error, points, digest, seconds, knowledge}. A failure is an outcome too.

    source: gives the knowledge that the cell's source names. keep: whether what is learned is wanted.
    checkpoints: a folder for the cell's state, from which a later call goes on bit for bit; None: no checkpoints.
    checkpoint_seconds: time between two of them; each is made at an evaluation.
    on_point: is told each evaluation of this call.
    """
    before: dict[str, Any] = curve.columns([])
    points: list[EvalPoint] = []
    error, knowledge = None, None
    started = time.perf_counter()
    try:
        training = train(cell, source(cell))
        path = checkpoints / f"{cell.id}.checkpoint" if checkpoints and training.resumable else None
        before = _resume(training, path)
        saved = time.perf_counter()
        for point in training:
            points.append(point)
            on_point(point)
            if path is not None and time.perf_counter() - saved >= checkpoint_seconds:
                _save(path, training, curve.joined(before, curve.columns(points)))
                saved = time.perf_counter()
        knowledge = training.knowledge().to_bytes() if keep else None
    except Exception as exception:
        where = traceback.extract_tb(exception.__traceback__)[-1]
        error = f"{type(exception).__name__}: {exception} ({Path(where.filename).name}:{where.lineno})"
    table = curve.joined(before, curve.columns(points))
    return {
        "cell": cell.to_json(),
        "status": "failed" if error else "done",
        "error": error,
        "points": table,
        "digest": curve.digest(table),
        "seconds": table["seconds"][-1] if not error else time.perf_counter() - started,
        "knowledge": knowledge,
    }


def _resume(training: Training, path: Path | None) -> dict[str, Any]:
    """Bring the training to its last checkpoint, if it has one; the points up to there."""
    state = checkpoint.load_if_whole(path) if path is not None else None
    if state is None:
        return curve.columns([])
    training.restore(state["training"])
    points: dict[str, Any] = state["points"]
    return points


def _save(path: Path, training: Training, points: dict[str, Any]) -> None:
    """Save a checkpoint; a disk that is full costs the checkpoint, not the cell."""
    try:
        checkpoint.save(path, {"training": training.state(), "points": points})
    except OSError:
        return
