"""What the driver and its workers tell each other. Light to import: a driver trains nothing."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any, Literal

from trainables import curve
from trainables.cell import Cell
from trainables.training.end_states import EndStates

STOP = "STOP"
"""The file in the folder of checkpoints with which the driver asks its workers to stop."""

LOGGER = "deltatune"
"""The parent of all of deltatune's loggers."""


@dataclass(frozen=True)
class Outcome:
    """The outcome of a cell, as its worker reports it."""

    cell: Cell
    status: Literal["done", "failed", "stopped"]
    error: str | None
    """Why it failed, or was stopped, in a sentence."""
    points: dict[str, list[float | int | None]]
    """The evaluation curve as columns; for a failed or stopped cell, up to its end."""
    digest: str
    """`curve.digest` of the points."""
    seconds: float
    """Wall time of the cell."""
    knowledge: bytes | None = None
    """What was learned, if it was to be kept."""
    continued: int = 0
    """The episode at which it went on from the end state of a shorter cell; 0: it did not."""
    earlier_seconds: float = 0.0
    """How many of its seconds are from before this run, by a checkpoint or an end state."""

    @classmethod
    def of(cls, cell: Cell, error: str, points: Any, seconds: float) -> Outcome:
        """Return the outcome of a cell: failed if there is an error, else done."""
        return cls(cell, "failed" if error else "done", error or None, points, curve.digest(points), seconds)


def lost(cell: Cell, error: str, seconds: float) -> Outcome:
    """Return the outcome of a cell whose worker is lost."""
    return Outcome.of(cell, error, curve.columns([]), seconds)


def stopped(cell: Cell, reason: str, points: dict[str, Any]) -> Outcome:
    """Return the outcome of a cell that a scheduler has stopped early, with its curve so far."""
    return replace(Outcome.of(cell, reason, points, points["seconds"][-1]), status="stopped")


@dataclass(frozen=True)
class WorkerPayload:
    """Constant arguments shipped to every worker of a stage."""

    sources: Mapping[str, Mapping[str, Any]]
    """The arrays of each source, by `Cell.source_key`."""
    keep: bool
    """Whether outcomes include the knowledge."""
    checkpoints: str | None
    """The folder for the states of long cells; None: a cell whose worker is lost starts again."""
    checkpoint_seconds: float
    """Time between two checkpoints of a cell."""
    plugins: Mapping[str, bytes]
    """The custom files that the driver has loaded (`plugins.loader.packed`)."""
    ends: EndStates | None = None
    """The end states to keep and to continue; None: none."""


@dataclass(frozen=True)
class Started:
    """A worker has started its pack."""

    pid: int
    node: str


@dataclass(frozen=True)
class Compiling:
    """A worker compiles a kernel that the cache on its disk lacks, which takes up to a minute for all of them."""


@dataclass(frozen=True)
class Progress:
    """The progress of a long cell."""

    cell: str
    share: float
    """Finished share of its episodes: 0 to 1."""
    step: int
    greedy_return: float


@dataclass(frozen=True)
class Ended:
    """Cells that have ended."""

    outcomes: tuple[Outcome, ...]


@dataclass(frozen=True)
class Reached:
    """All cells of a configuration have reached an evaluation, at which early stopping decides."""

    evaluations: int
    score: float
    points: tuple[tuple[str, dict[str, Any]], ...]
    """Cell id and the part of its curve since the last report."""


@dataclass(frozen=True)
class Logged:
    """Log messages of a worker: (logger, level, text)."""

    lines: tuple[tuple[str, int, str], ...]


Report = Started | Compiling | Progress | Ended | Reached | Logged
Tell = Callable[[Report], None]
"""Sends a report to the driver."""
Stop = Callable[[], bool]
"""Returns whether the driver has asked to stop."""
