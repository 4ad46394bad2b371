"""Writing to MLflow while a sweep runs: from one thread, never in the sweep's way."""

from __future__ import annotations

import contextlib
import queue
import threading
from collections.abc import Iterable
from pathlib import Path

from orchestrator.analysis.findings import Findings
from orchestrator.results.record import Record
from orchestrator.results.sweep_folder import Results
from orchestrator.tracking.mlflow_mirror import Mirror, sync

WAITING = 200
"""Records that wait for MLflow at the most. What comes on top is written at the end, from the disk."""

FIRST_PAUSE, LONGEST_PAUSE = 2.0, 60.0
"""Seconds until a store that has failed is tried again; doubled each time."""


class Tracker:
    """Hands the records of a sweep to its Mirror as they come; a store that is away is tried again and again."""

    def __init__(self, results: Results, uri: str) -> None:
        self._results, self.uri = results, uri
        self._queue: queue.Queue[tuple[str, Record] | None] = queue.Queue(maxsize=WAITING)
        self._closing = threading.Event()
        self._thread: threading.Thread | None = None
        self._mirror: Mirror | None = None
        self.error: Exception | None = None
        """Why the store has not got everything; `sync` makes good for it."""

    def record(self, stage: str, record: Record) -> None:
        """Queue the record of an ended cell."""
        if self._thread is None:
            self._thread = threading.Thread(target=self._work, name="mlflow", daemon=True)
            self._thread.start()
        try:
            self._queue.put_nowait((stage, record))
        except queue.Full:
            return

    def finish(self, findings: Findings, artifacts: Iterable[Path]) -> str | None:
        """Write all that is missing; the parent run's id, None where MLflow has failed."""
        self._closing.set()
        if self._thread is not None:
            self._thread.join()
        try:
            parent = sync(findings, self.uri, artifacts, self._mirror)
        except Exception as error:
            self.error = error
            return None
        self.error = None
        return parent

    def interrupt(self) -> None:
        """Stop writing, and say in MLflow that the sweep was interrupted."""
        self._closing.set()
        if self._thread is not None:
            self._thread.join()
        try:
            if self._mirror is not None:
                self._mirror.interrupted()
        except Exception as error:
            self.error = error

    def _work(self) -> None:
        pause = FIRST_PAUSE
        item: tuple[str, Record] | None = None
        while not self._closing.is_set():
            with contextlib.suppress(queue.Empty):
                item = item or self._queue.get(timeout=0.2)
            if item is None:
                continue
            try:
                self._write(*item)
                item, pause = None, FIRST_PAUSE
            except Exception as error:
                self.error, self._mirror = error, None
                self._closing.wait(pause)
                pause = min(2 * pause, LONGEST_PAUSE)

    def _write(self, stage: str, record: Record) -> None:
        self._mirror = self._mirror or Mirror(self._results, self.uri)
        self._mirror.write_cell(stage, record.head, lambda: record)
