"""The progress of a stage: counted by the driver, and written to a file for `deltatune watch` and `status`."""

from __future__ import annotations

import json
import logging
import time
from dataclasses import asdict, dataclass, field
from pathlib import Path

from orchestrator.results.records.record import Record
from trainables.curve import auc
from trainables.plugins.names import short
from trainables.storage.atomic import write_atomic
from trainables.storage.paths import read_range

log = logging.getLogger("deltatune.results")

FILE = ".progress.json"

KNOWN_AFTER = 1.0
"""Seconds after which a rate is told, and with it what is left."""


@dataclass(frozen=True)
class Snapshot:
    """The progress of a stage at one moment."""

    stage: str
    total: int
    done: int = 0
    failed: int = 0
    stopped: int = 0
    running: int = 0
    further: int = 0
    """Cells that may follow, if a sequential test over seeds goes on."""
    share: float = 0.0
    """Finished share of the stage, with the finished parts of running cells: 0 to 1."""
    steps_per_second: float | None = None
    """Training steps of all workers together."""
    seconds_left: float | None = None
    best: str = ""
    """The highest AUC so far on the task of the cell that ended last, with its agent."""
    updated: float = 0.0
    """Seconds since 1970."""
    compiling: bool = False
    """Whether workers compile kernels, and no cell has reported since."""

    @property
    def ended(self) -> int:
        """Cells that have ended, with any status."""
        return self.done + self.failed + self.stopped

    def counts(self) -> str:
        """Return '2 running, 0 failed', with the number stopped early if any."""
        stopped = f", {self.stopped} stopped early" if self.stopped else ""
        return f"{self.running} running, {self.failed} failed{stopped}"

    def rate(self) -> str:
        """Return '12,300 steps/s'."""
        return f"{self.steps_per_second:,.0f} steps/s" if self.steps_per_second else ""

    def left(self) -> str:
        """Return 'about 4 min left', or 'compiling'."""
        if self.compiling:
            return "compiling"
        if self.seconds_left is None or self.ended >= self.total:
            return ""
        for size, name in ((3600, "h"), (60, "min")):
            if self.seconds_left >= 1.5 * size:
                return f"about {self.seconds_left / size:.0f} {name} left"
        return f"about {self.seconds_left:.0f} s left"

    def _percent(self) -> str:
        """Return ' (12%)', with the finished parts of running cells, where that adds to the count; else empty."""
        return f" ({self.share:.0%})" if self.ended / max(self.total, 1) < round(self.share, 2) < 1 else ""

    def line(self) -> str:
        """Return everything in one line."""
        parts = [
            f"{self.stage}: {self.ended} of {self.total} cells{self._percent()}",
            f"up to {self.further:,} more if comparisons stay open" if self.further else "",
            self.counts(),
            self.rate(),
            self.left(),
            self.best,
        ]
        return ", ".join(part for part in parts if part)


@dataclass
class Progress:
    """Counts the events of a stage."""

    stage: str
    total: int
    further: int = 0
    _count: dict[str, int] = field(default_factory=lambda: {"done": 0, "failed": 0, "stopped": 0})
    _shares: dict[str, tuple[float, int]] = field(default_factory=dict)
    """Running cell to (share, steps)."""
    _steps: int = 0
    _running: int = 0
    _compiling: bool = False
    _best: dict[str, tuple[float, str]] = field(default_factory=dict)
    """Task to the highest AUC on it and its agent; the task of the cell that ended last comes last."""
    _first: float | None = None
    """When the stage was first heard of; a cell that ended first had begun by then."""
    _before: tuple[float, int] = (0.0, 0)
    """The share and the steps that were done by then, in an earlier run or while kernels were compiled."""

    def ended(self, record: Record) -> None:
        """Count an ended cell."""
        self.over(record.cell.id)
        self._count[record.status] += 1
        self._steps += int((record.points["step"] or [0])[-1] or 0)
        if self._compiling:  # the time that this cell took says nothing of the next ones
            self._compiling, self._first = False, time.monotonic()
            self._before = self._passed(), self._all_steps()
        self._first = self._first or time.monotonic() - record.seconds
        if record.status == "done":
            score = auc(record.returns), record.cell.agent
            self._best[record.cell.task] = max(self._best.pop(record.cell.task, score), score)

    def over(self, cell: str) -> None:
        """Forget a cell that no longer runs."""
        self._shares.pop(cell, None)

    def running(self, packs: int) -> None:
        """Update the number of busy workers."""
        self._running = packs

    def compiling(self) -> None:
        """Note that a worker compiles kernels."""
        self._compiling = True

    def share(self, cell: str, share: float, step: int) -> None:
        """Update the finished share of a long cell."""
        self._compiling = False
        if self._first is None:
            self._first, self._before = time.monotonic(), (share, step)
        self._shares[cell] = share, step

    def snapshot(self) -> Snapshot:
        """Return the present progress."""
        passed, steps = self._passed(), self._all_steps()
        seconds = time.monotonic() - self._first if self._first else 0.0
        known, gained = seconds >= KNOWN_AFTER, passed - self._before[0]
        return Snapshot(
            stage=self.stage,
            total=self.total,
            further=self.further,
            **self._count,
            running=self._running,
            share=passed / self.total if self.total else 1.0,
            steps_per_second=(steps - self._before[1]) / seconds if known else None,
            seconds_left=seconds / gained * (self.total - passed) if known and gained > 0 else None,
            compiling=self._compiling,
            best=self._best_text(),
            updated=time.time(),
        )

    def _passed(self) -> float:
        """Return how many cells have ended, with the finished shares of running ones."""
        return sum(self._count.values()) + sum(share for share, _ in self._shares.values())

    def _all_steps(self) -> int:
        """Return the training steps of ended and running cells."""
        return self._steps + sum(step for _, step in self._shares.values())

    def _best_text(self) -> str:
        """Return 'best AUC on TASK: -12.3 (AGENT)' for the last task; AUCs of different tasks are not comparable."""
        if not self._best:
            return ""
        task, (score, agent) = next(reversed(self._best.items()))
        return f"best AUC on {short(task)}: {score:.1f} ({short(agent)})"


def write(folder: Path, snapshot: Snapshot) -> None:
    """Write a snapshot to the sweep's folder; errors are logged and ignored, since it is no result."""
    try:
        write_atomic(folder / FILE, json.dumps(asdict(snapshot)).encode())
    except Exception as error:  # each kind of storage raises different errors
        log.info("the progress cannot be written to %s: %s", folder, error)


def read(folder: Path) -> Snapshot | None:
    """Return the last snapshot of a sweep, or None."""
    try:
        return Snapshot(**json.loads(read_range(folder / FILE)))
    except (OSError, ValueError, TypeError):
        return None
