"""The display of a running sweep: a live line in a terminal, a calm one now and then in a log file."""

from __future__ import annotations

import time
from types import TracebackType

from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

from orchestrator.record import Record
from trainables.curve import auc

LOG_EVERY = 15.0
"""Seconds between lines where there is no terminal."""


class Display:
    """Counts of one stage: done, running, failed, left; time to go; the best cell so far."""

    def __init__(self, console: Console, stage: str, total: int) -> None:
        self._console, self._stage, self._total = console, stage, total
        self._done = self._failed = self._running = 0
        self._shares: dict[str, float] = {}
        self._best: tuple[float, str] | None = None
        self._first: float | None = None
        self._logged = time.monotonic()
        self._progress = Progress(
            TextColumn("[bold]{task.description}"),
            BarColumn(bar_width=24),
            TextColumn("{task.fields[ended]}/{task.total}"),
            TextColumn("{task.fields[counts]}"),
            TimeElapsedColumn(),
            TextColumn("{task.fields[left]}"),
            TextColumn("{task.fields[best]}"),
            console=console,
            refresh_per_second=4,
        )
        self._bar = self._progress.add_task(stage, total=total, ended=0, counts="starting workers", left="", best="")

    def __enter__(self) -> Display:
        if self._console.is_terminal:
            self._progress.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._console.is_terminal:
            self._progress.stop()
        else:
            self._console.print(self._line(), soft_wrap=True)

    def ended(self, record: Record) -> None:
        """Count an ended cell."""
        self._first = self._first or time.monotonic() - record.seconds
        self._shares.pop(record.cell.id, None)
        self._done += record.status == "done"
        self._failed += record.status == "failed"
        if record.status == "done":
            score = auc(record.returns), f"{record.cell.agent} on {record.cell.task}"
            self._best = max(self._best or score, score)
        self._show()

    def progress(self, cell: str, share: float, greedy_return: float) -> None:
        """Take in how much of a long cell is done."""
        self._first = self._first or time.monotonic()
        self._shares[cell] = share
        self._show()

    def running(self, cells: int) -> None:
        """Take in how many cells are running."""
        self._running = cells
        self._show()

    def _show(self) -> None:
        best = f"best AUC {self._best[0]:.1f} ({self._best[1]})" if self._best else ""
        self._progress.update(
            self._bar,
            total=self._total,
            completed=self._done + self._failed + sum(self._shares.values()),
            ended=self._done + self._failed,
            counts=f"{self._running} running, {self._failed} failed",
            left=self._left(),
            best=best,
        )
        if not self._console.is_terminal and time.monotonic() - self._logged > LOG_EVERY:
            self._logged = time.monotonic()
            self._console.print(self._line(), soft_wrap=True)

    def _left(self) -> str:
        ended = self._done + self._failed + sum(self._shares.values())
        if not ended or self._first is None:
            return ""
        seconds = (time.monotonic() - self._first) / ended * (self._total - ended)
        return f"about {seconds:.0f} s left" if seconds < 90 else f"about {seconds / 60:.0f} min left"

    def _line(self) -> str:
        ended = self._done + self._failed
        parts = [f"{self._stage}: {ended} of {self._total} cells", f"{self._running} running", f"{self._failed} failed"]
        best = [f"best AUC {self._best[0]:.1f} ({self._best[1]})"] if self._best else []
        return ", ".join([*parts, *([self._left()] if ended < self._total and self._left() else []), *best])
