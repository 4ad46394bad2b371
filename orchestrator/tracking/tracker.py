"""Writing to a tracker while a sweep runs: from one thread, never in the sweep's way."""

from __future__ import annotations

import contextlib
import logging
import queue
import threading
from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING

from orchestrator import clock
from orchestrator.results.records.record import Record
from orchestrator.results.sweep_folder import Results
from orchestrator.tracking.backend import TrackingBackend
from orchestrator.tracking.sync import sync
from orchestrator.tracking.trackers import kind_of
from trainables.errors import InputError

if TYPE_CHECKING:  # a backend may take seconds to import: while cells run, in the thread that writes
    from orchestrator.analysis.findings import Findings

WAITING = 200
"""Records that wait for the tracker at the most. What comes on top is written at the end, from the disk."""

FIRST_PAUSE, LONGEST_PAUSE = 2.0, 60.0
"""Seconds until a store that has failed is tried again; doubled each time."""


PATIENCE = 30.0
"""Seconds that a sweep waits at its end for a `deltatune sync` that is at work."""

log = logging.getLogger("deltatune.tracking")


class Tracker:
    """Hands the records of a sweep to a backend as they come; a store that is away is tried again and again."""

    def __init__(self, results: Results, uri: str) -> None:
        self._results, self.uri = results, uri
        self.kind = kind_of(uri)
        self._queue: queue.Queue[tuple[str, Record] | None] = queue.Queue(maxsize=WAITING)
        self._closing = threading.Event()
        self._thread: clock.Worker | None = None
        self._backend: TrackingBackend | None = None
        self._held = contextlib.ExitStack()
        self._holds = False
        self.error: Exception | None = None
        """Why the store has not got everything; `sync` makes good for it."""
        self.parent: str | None = None
        """The name of the copy, once it is whole: in MLflow, the sweep's run."""

    def record(self, stage: str, record: Record) -> None:
        """Queue the record of an ended cell."""
        if self._thread is None:
            self._thread = clock.beside(self._work, self.kind.key)
        try:
            self._queue.put_nowait((stage, record))
        except queue.Full:
            return

    def finish(self, findings: Findings, artifacts: Iterable[Path]) -> str | None:
        """Write all that is missing; the copy's name (in MLflow, the parent run's id), None where that has failed."""
        self._close()
        try:
            self._backend = self._backend or self._connected(PATIENCE)
            parent = sync(findings, self.uri, artifacts, self._backend)
        except Exception as error:
            _log(f"{self.kind.title}: not everything is there", error)
            self.error = error
            self.stop("FAILED")
            return None
        self.error, self.parent = None, parent
        self._held.close()
        return parent

    def stop(self, status: str | None = "KILLED") -> None:
        """Stop writing, and give the sweep's run `status`; None: it is another driver's."""
        self._close()
        try:
            if self._backend is not None and status is not None:
                self._backend.end(status)
        except Exception as error:
            _log(f"{self.kind.title}: how the sweep ended is not there", error)
            self.error = self.error or error
        self._held.close()

    def _close(self) -> None:
        """End the thread."""
        self._closing.set()
        if self._thread is not None:
            self._thread.join()

    def _connected(self, patience: float = 0.0) -> TrackingBackend:
        """Return the opened backend, when nobody else writes this sweep there; InputError where somebody does.

        What one process has found there is no longer so once another writes. patience: seconds to wait for the other.
        """
        deadline = clock.monotonic() + patience
        while not self._holds:
            try:
                self._held.enter_context(self.kind.held(self._results.folder))
                self._holds = True
            except InputError:
                if clock.monotonic() >= deadline:
                    raise
                clock.sleep(0.2)
        return self.kind.load()(self._results, self.uri)

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
                _log(f"{self.kind.title}: tried again later", error)
                self.error, self._backend = error, None
                clock.wait(self._closing, pause)
                pause = min(2 * pause, LONGEST_PAUSE)

    def _write(self, stage: str, record: Record) -> None:
        self._backend = self._backend or self._connected()
        self._backend.write_cell(stage, record.head, lambda: record)


def _log(what: str, error: Exception) -> None:
    log.info("%s: %s: %s", what, type(error).__name__, " ".join(str(error).split())[:500])
