"""Writing to MLflow while a sweep runs: from one thread, never in the sweep's way."""

from __future__ import annotations

import contextlib
import logging
import queue
import threading
from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING

from orchestrator import clock
from orchestrator.results.lock import writing_to_mlflow
from orchestrator.results.records.record import Record
from orchestrator.results.sweep_folder import Results
from trainables.errors import InputError

if TYPE_CHECKING:  # MLflow takes seconds to import: while cells run, in the thread that writes
    from orchestrator.analysis.findings import Findings
    from orchestrator.tracking.mlflow_mirror import Mirror

WAITING = 200
"""Records that wait for MLflow at the most. What comes on top is written at the end, from the disk."""

FIRST_PAUSE, LONGEST_PAUSE = 2.0, 60.0
"""Seconds until a store that has failed is tried again; doubled each time."""


PATIENCE = 30.0
"""Seconds that a sweep waits at its end for a `deltatune sync` that is at work."""

log = logging.getLogger("deltatune.tracking")


class Tracker:
    """Hands the records of a sweep to its Mirror as they come; a store that is away is tried again and again."""

    def __init__(self, results: Results, uri: str) -> None:
        self._results, self.uri = results, uri
        self._queue: queue.Queue[tuple[str, Record] | None] = queue.Queue(maxsize=WAITING)
        self._closing = threading.Event()
        self._thread: clock.Worker | None = None
        self._mirror: Mirror | None = None
        self._held = contextlib.ExitStack()
        self._holds = False
        self.error: Exception | None = None
        """Why the store has not got everything; `sync` makes good for it."""

    def record(self, stage: str, record: Record) -> None:
        """Queue the record of an ended cell."""
        if self._thread is None:
            self._thread = clock.beside(self._work, "mlflow")
        try:
            self._queue.put_nowait((stage, record))
        except queue.Full:
            return

    def finish(self, findings: Findings, artifacts: Iterable[Path]) -> str | None:
        """Write all that is missing; the parent run's id, None where MLflow has failed."""
        self._close()
        try:
            from orchestrator.tracking.mlflow_mirror import sync

            self._mirror = self._mirror or self._connected(PATIENCE)
            parent = sync(findings, self.uri, artifacts, self._mirror)
        except Exception as error:
            _log("MLflow has not got everything", error)
            self.error = error
            self.stop("FAILED")
            return None
        self.error = None
        self._held.close()
        return parent

    def stop(self, status: str | None = "KILLED") -> None:
        """Stop writing, and give the sweep's run `status`; None: it is another driver's."""
        self._close()
        try:
            if self._mirror is not None and status is not None:
                self._mirror.end(status)
        except Exception as error:
            _log("MLflow does not know how the sweep ended", error)
            self.error = self.error or error
        self._held.close()

    def _close(self) -> None:
        """End the thread."""
        self._closing.set()
        if self._thread is not None:
            self._thread.join()

    def _connected(self, patience: float = 0.0) -> Mirror:
        """Return a new mirror, when nobody else writes this sweep into MLflow; InputError where somebody does.

        What one process has found there is no longer so once another writes. patience: seconds to wait for the other.
        """
        deadline = clock.monotonic() + patience
        while not self._holds:
            try:
                self._held.enter_context(writing_to_mlflow(self._results.folder))
                self._holds = True
            except InputError:
                if clock.monotonic() >= deadline:
                    raise
                clock.sleep(0.2)
        from orchestrator.tracking.mlflow_mirror import Mirror

        return Mirror(self._results, self.uri)

    def _work(self) -> None:
        pause = FIRST_PAUSE
        item: tuple[str, Record] | None = None
        while not self._closing.is_set():
            with contextlib.suppress(queue.Empty):
                item = item or clock.take(self._queue, 0.2)
            if item is None:
                continue
            try:
                self._write(*item)
                item, pause = None, FIRST_PAUSE
            except Exception as error:
                _log("MLflow is tried again later", error)
                self.error, self._mirror = error, None
                clock.wait(self._closing, pause)
                pause = min(2 * pause, LONGEST_PAUSE)

    def _write(self, stage: str, record: Record) -> None:
        self._mirror = self._mirror or self._connected()
        self._mirror.write_cell(stage, record.head, lambda: record)


def _log(what: str, error: Exception) -> None:
    log.info("%s: %s: %s", what, type(error).__name__, " ".join(str(error).split())[:500])
