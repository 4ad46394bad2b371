"""Writes to a tracker from a background thread while a sweep runs."""

from __future__ import annotations

import contextlib
import logging
import queue
import threading
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import TYPE_CHECKING

from orchestrator import clock
from orchestrator.results.lock import Hold
from orchestrator.results.records.record import Record
from orchestrator.results.sweep_folder import Results
from orchestrator.tracking.backend import TrackingBackend
from orchestrator.tracking.sync import sync
from orchestrator.tracking.trackers import kind_of
from trainables.errors import InputError

if TYPE_CHECKING:  # a backend may take seconds to import, so the background thread does that while cells run
    from orchestrator.analysis.findings import Findings

WAITING = 200
"""Records that may wait for the tracker. Further ones are written at the end, from the disk."""

FIRST_PAUSE, LONGEST_PAUSE = 2.0, 60.0
"""Seconds before a failed store is tried again; doubled each time."""


IDLE = 60.0
"""Seconds that the thread waits for a record at a time."""

PATIENCE = 30.0
"""Seconds that a sweep waits at its end for a running `deltatune sync`."""

log = logging.getLogger("deltatune.tracking")


class Tracker:
    """Passes the records of a sweep to a backend as they arrive, and retries an unreachable store."""

    def __init__(self, results: Results, uri: str) -> None:
        self._results, self.uri = results, uri
        self.kind = kind_of(uri)
        self._queue: queue.Queue[tuple[str, Record] | None] = queue.Queue(maxsize=WAITING)
        self._closing = threading.Event()
        self._thread: clock.Worker | None = None
        self._backend: TrackingBackend | None = None
        self._held = contextlib.ExitStack()
        self._unwatch: Callable[[], None] | None = None
        """Stops what logs the machine's load."""
        self._hold: Hold | None = None
        self.error: Exception | None = None
        """Why the copy is incomplete, or None; `deltatune sync` completes it."""
        self.parent: str | None = None
        """The name of the copy once it is complete: in MLflow, the id of the sweep's run."""

    def record(self, stage: str, record: Record) -> None:
        """Queue the record of an ended cell."""
        if self._thread is None:
            self._thread = clock.in_background(self._work, self.kind.key)
        try:
            self._queue.put_nowait((stage, record))
        except queue.Full:
            return

    def finish(self, findings: Findings, artifacts: Iterable[Path]) -> str | None:
        """Write all that is missing, and return the copy's name (in MLflow, the parent run's id); None on failure."""
        self._close()
        try:
            parent = sync(findings, self.uri, artifacts, self._connected(PATIENCE))
        except Exception as error:
            _log(f"{self.kind.title} is incomplete", error)
            self.error = error
            self.stop("FAILED")
            return None
        self.error, self.parent = None, parent
        self._held.close()
        return parent

    def stop(self, status: str | None = "KILLED") -> None:
        """Stop writing, and set the `status` of the sweep's run; None: leave it, since another driver has the sweep."""
        self._close()
        try:
            if self._backend is not None and status is not None:
                self._backend.end(status)
        except Exception as error:
            _log(f"{self.kind.title} lacks the final status", error)
            self.error = self.error or error
        self._held.close()

    def _close(self) -> None:
        """End the thread."""
        self._closing.set()
        with contextlib.suppress(queue.Full):  # it does not wait for anything then
            self._queue.put_nowait(None)
        if self._thread is not None:
            self._thread.join()
        if self._unwatch is not None:
            self._unwatch()
            self._unwatch = None

    def _connected(self, patience: float = 0.0) -> TrackingBackend:
        """Return the opened backend. Raises InputError where another process writes this sweep there.

        It is opened with the lock held, since another process may have changed the copy. patience: seconds to wait.
        """
        if self._hold is not None and self._hold.lost:
            self._held.close()
            self._hold = self._backend = None
        deadline = clock.monotonic() + patience
        while self._hold is None:
            try:
                self._hold = self._held.enter_context(self.kind.held(self._results.folder))
            except InputError:
                if clock.monotonic() >= deadline:
                    raise
                clock.sleep(0.2)
        if self._backend is None:
            self._backend = self.kind.load()(self._results, self.uri, self._hold.check_surely)
        return self._backend

    def _work(self) -> None:
        pause = FIRST_PAUSE
        item: tuple[str, Record] | None = None
        while not self._closing.is_set():
            with contextlib.suppress(queue.Empty):
                item = item or clock.take(self._queue, IDLE)
            if item is None:
                continue
            try:
                self._write(*item)
                item, pause = None, FIRST_PAUSE
            except Exception as error:
                _log(f"{self.kind.title} will be tried again", error)
                self.error, self._backend = error, None
                clock.wait(self._closing, pause)
                pause = min(2 * pause, LONGEST_PAUSE)

    def _write(self, stage: str, record: Record) -> None:
        backend = self._connected()
        if self._unwatch is None:
            self._unwatch = self.kind.watched(self.uri, backend.parent)
        backend.write_cell(stage, record.head, lambda: record)


def _log(what: str, error: Exception) -> None:
    log.info("%s: %s: %s", what, type(error).__name__, " ".join(str(error).split())[:500])
