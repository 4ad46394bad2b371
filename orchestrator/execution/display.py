"""The display of a running sweep: a live line in a terminal, else a line every LOG_EVERY seconds."""

from __future__ import annotations

import logging
import math
import os
import sys
import time
from collections import Counter
from pathlib import Path
from types import TracebackType
from typing import Any

from rich.console import Console
from rich.progress import BarColumn, ProgressColumn, TextColumn, TimeElapsedColumn
from rich.progress import Progress as Bars
from rich.table import Column

from orchestrator.results import driver_log, progress
from orchestrator.results.progress import Progress, Snapshot
from orchestrator.results.records.record import Record
from trainables.storage.paths import is_local
from trainables.training import messages

LOG_EVERY = 15.0
"""Seconds between lines where there is no terminal, and in the sweep's log."""


MAX_NOTES = 5
"""Warnings of one logger that a stage shows; the driver log has all."""

COMPILING = "compiling the training code, once for this machine and version: up to a minute"

log = logging.getLogger("deltatune.sweep")


def bars(console: Console) -> Bars:
    """Return the live line: bar and count, and more columns as far as the terminal is wide enough."""
    width = console.width
    columns: list[ProgressColumn] = [_text("[bold]{task.description}"), BarColumn(24 if width >= 120 else 12)]
    columns += [_text("{task.fields[ended]}/{task.total}{task.fields[more]}"), _text("{task.fields[percent]}")]
    columns += [_text("{task.fields[counts]}")] if width >= 80 else []
    columns += [TimeElapsedColumn(Column(no_wrap=True))]
    columns += [_text("{task.fields[rate]}")] if width >= 120 else []
    columns += [_text("{task.fields[left]}")]
    columns += [_text("{task.fields[best]}", width - 115)] if width >= 140 else []
    return Bars(*columns, console=console, refresh_per_second=4)


def _text(text: str, most: int | None = None) -> TextColumn:
    """Return a column of the live line that never wraps, cut at `most` characters."""
    return TextColumn(text, table_column=Column(no_wrap=True, overflow="ellipsis", max_width=most))


def fields(snapshot: Snapshot) -> dict[str, Any]:
    """Return a snapshot's fields for the live line."""
    return {
        "description": snapshot.stage,
        "total": snapshot.total,
        "completed": snapshot.share * snapshot.total,
        "ended": snapshot.ended,
        "more": "+" if snapshot.further else "",
        "percent": f"{snapshot.share:.0%}",
        "counts": snapshot.counts(),
        "rate": snapshot.rate(),
        "left": snapshot.left(),
        "best": snapshot.best,
    }


class _Notes(logging.Handler):
    """Shows warnings on the console as they come."""

    def __init__(self, console: Console) -> None:
        super().__init__(logging.WARNING)
        self._console = console
        self._shown: Counter[str] = Counter()

    def emit(self, record: logging.LogRecord) -> None:
        self._shown[record.name] += 1
        if self._shown[record.name] <= MAX_NOTES:
            self._console.print(record.getMessage(), soft_wrap=True, style="yellow", markup=False)
        elif self._shown[record.name] == MAX_NOTES + 1:
            self._console.print(f"more of these: see {driver_log.FILE}", soft_wrap=True, style="yellow")


class Display:
    """Shows a stage's progress: cells done, running, failed, left; remaining time; best cell. Also writes the log."""

    def __init__(
        self, console: Console, stage: str, total: int, folder: Path, further: int = 0, said: set[str] | None = None
    ) -> None:
        """further: cells that may follow if a sequential test over seeds goes on. said: what a sweep says only once."""
        self._console, self._folder = console, folder
        self._progress = Progress(stage, total, further)
        self._logged = self._written = self._shown = time.monotonic()
        self._any = False
        self._said = set() if said is None else said
        self._write_every = 2.0 if is_local(folder) else LOG_EVERY
        self._bars = bars(console)
        self._notes = _Notes(console)
        empty = fields(self._progress.snapshot()) | {"counts": "starting workers"}
        self._bar = self._bars.add_task(**empty)

    def __enter__(self) -> Display:
        if self._console.is_terminal:
            self._bars.start()
        logging.getLogger(driver_log.LOGGER).addHandler(self._notes)
        log.info("%s: %d cells to run", self._progress.stage, self._progress.total)
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        snapshot = self._progress.snapshot()
        self._bars.update(self._bar, **fields(snapshot))
        if self._console.is_terminal:
            self._bars.stop()
        else:
            self._console.print(snapshot.line(), soft_wrap=True)
        log.info("%s", snapshot.line())
        logging.getLogger(driver_log.LOGGER).removeHandler(self._notes)
        progress.write(self._folder, snapshot)

    def ended(self, record: Record) -> None:
        """Count an ended cell."""
        self._progress.ended(record)
        if record.status == "failed":
            cell = record.cell
            log.info("failed: %s %s on %s, seed %d: %s", cell.id, cell.agent, cell.task, cell.seed, record.error)
        if not self._any:  # said at once, where there is no live line: the sweep is at work
            self._any, self._logged, self._shown = True, -math.inf, -math.inf
        self._show()

    def compiling(self) -> None:
        """Say once that workers compile; the live line says so until a cell reports."""
        if COMPILING not in self._said:
            self._said.add(COMPILING)
            log.info("%s", COMPILING)
            self._console.print(COMPILING, soft_wrap=True)
        self._progress.compiling()
        self._show()

    def progress(self, report: messages.Progress) -> None:
        """Update the finished share of a long cell."""
        self._progress.share(report.cell, report.share, report.step)
        self._show()

    def over(self, cell: str) -> None:
        """Forget a cell that no longer runs."""
        self._progress.over(cell)

    def running(self, packs: int) -> None:
        """Update the number of busy workers."""
        self._progress.running(packs)
        self._show()

    def abandon(self, address: str) -> None:
        """Exit this process, since Ray hangs without the cluster's head. All finished cells are on disk."""
        text = f"the head of the Ray cluster at {address} is gone; finished cells are kept, the same command continues"
        log.error("%s", text)
        driver_log.flush()
        self._bars.stop()
        print(f"error: {text}", file=sys.stderr, flush=True)
        os._exit(1)

    def _show(self) -> None:
        now = time.monotonic()
        if now - self._shown < 0.1:
            return
        self._shown = now
        snapshot = self._progress.snapshot()
        self._bars.update(self._bar, **fields(snapshot))
        if now - self._written > self._write_every:
            self._written = now
            progress.write(self._folder, snapshot)
        if now - self._logged > LOG_EVERY:
            self._logged = now
            log.info("%s", snapshot.line())
            if not self._console.is_terminal:
                self._console.print(snapshot.line(), soft_wrap=True)
