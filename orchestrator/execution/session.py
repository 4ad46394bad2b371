"""A sweep's session: takes the lock first, then writes its files; sets the tracker's status and frees the lock."""

from __future__ import annotations

import logging
import signal
import threading
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rich.console import Console

from orchestrator.cluster import ending
from orchestrator.errors import InterruptedSweepError, LeaseLostError, SweepError
from orchestrator.execution.interrupt import stop_now
from orchestrator.execution.settings import RunSummary, Settings
from orchestrator.execution.sweep import foresee, run_held
from orchestrator.model_registry import pretrained
from orchestrator.planning.extras import require_runnable
from orchestrator.planning.plan import SOURCE
from orchestrator.results.driver_log import logging_to
from orchestrator.results.lock import Hold, locked
from orchestrator.results.records.record import Record
from orchestrator.results.sweep_folder import Results
from orchestrator.tracking.tracker import Tracker
from search_spaces.search_space import SearchSpace
from trainables.errors import InputError

if TYPE_CHECKING:
    from orchestrator.analysis.findings import Findings

log = logging.getLogger("deltatune.session")


class SweepSession:
    """One driver of one sweep, from `open` to the end of the block."""

    def __init__(self, results: Results, tracker: Tracker | None, console: Console, hold: Hold) -> None:
        self.results, self.tracker = results, tracker
        self._console, self._hold = console, hold
        self._ended = False

    @classmethod
    @contextmanager
    def open(
        cls,
        storage: Path,
        name: str,
        space: SearchSpace,
        *,
        sources: Sequence[pretrained.Pretrained] = (),
        tracking_uri: str | None = None,
        console: Console | None = None,
    ) -> Iterator[SweepSession]:
        """Open the sweep `name` in `storage`, new or extended by `space`: take its lock, then write its files.

        sources: pretrained ones, which are not trained. tracking_uri: the tracker to write to; None: none.
        Raises InputError, and changes nothing, where another driver runs the sweep or the folder belongs to another
        search space. However the block ends, the tracker gets the final status and the lock is released; after an
        error a sentence says where the results are.
        """
        console = console or Console(quiet=True)
        require_runnable(space)
        results = Results.prepare(storage, name)
        with _signals(), locked(results.folder, on_lost=stop_now) as hold, logging_to(results.folder):
            results.guard(hold)
            results.begin(space)
            pretrained.keep(sources, results)
            session = cls(results, Tracker(results, tracking_uri) if tracking_uri else None, console, hold)
            try:
                yield session
            except BaseException as error:
                session._left_by(error)
                raise
            finally:
                session._end("KILLED")
                ending.wait()

    def run(self, settings: Settings, meanwhile: Callable[[], object] = lambda: None) -> RunSummary:
        """Run the missing cells; see `run_held`. A summary with `left` means that the run was interrupted.

        meanwhile: called in a thread when the first cell has ended, for instance to import what publishing needs.
        """
        begun: list[threading.Thread] = []

        def ahead(stage: str) -> None:
            if stage == SOURCE:
                _quietly(lambda: foresee(self.results.space(), settings))
            _quietly(meanwhile)

        def record(stage: str, record: Record) -> None:
            if not begun:
                begun.append(threading.Thread(target=ahead, args=(stage,), name="meanwhile", daemon=True))
                begun[0].start()
            if self.tracker:
                self.tracker.record(stage, record)

        tally = run_held(self.results, settings, self._console, record)
        if tally.left:
            try:
                self._hold.check()
            except LeaseLostError as error:
                raise SweepError(str(error)) from None
            self._end("KILLED")
        return tally

    def finish(self, findings: Findings, artifacts: Iterable[Path]) -> list[str]:
        """Write the results to the tracker, and sources to MLflow's registry; return the registered models.

        `tracker.error` says what could not be written; the results on disk are complete without it.
        """
        if self.tracker is None:
            return []
        parent = self.tracker.finish(findings, artifacts)
        self._ended = True
        if parent is None or not self.tracker.kind.has_registry:
            return []
        from orchestrator.model_registry.mlflow_registry import register

        try:
            self._hold.check_surely()
            return register(self.results, self.tracker.uri, parent)
        except Exception as error:
            log.warning("the sources are not in MLflow's registry: %s: %s", type(error).__name__, error)
            self.tracker.error = error
            return []

    def _left_by(self, error: BaseException) -> None:
        """Report an error that ends the session: to the tracker, and in a sentence unless it is bad input."""
        stopped = isinstance(error, KeyboardInterrupt | InterruptedSweepError)
        known = self._ended
        self._end("KILLED" if stopped else "FAILED")
        if known or isinstance(error, InputError) or not isinstance(error, Exception | KeyboardInterrupt):
            return
        log.error("the sweep has failed", exc_info=error)
        try:
            there = len(self.results.heads())
            self._console.print(
                f"{there} finished cells are kept in {self.results.folder}; the same command continues from there",
                soft_wrap=True,
            )
        except Exception as unsaid:  # the error itself matters more
            log.info("where the results are was not said: %s", unsaid)

    def _end(self, status: str) -> None:
        """Set the tracker's status, once, unless another driver has taken over the sweep."""
        if not self._ended and self.tracker is not None:
            self.tracker.stop(None if self._hold.lost else status)
        self._ended = True


def _quietly(work: Callable[[], object]) -> None:
    """Run `work` and ignore its errors, which occur again where its result is needed."""
    try:
        work()
    except Exception as error:
        log.info("%s: %s", type(error).__name__, error)


@contextmanager
def _signals() -> Iterator[None]:
    """Turn SIGTERM and SIGHUP into an error, so that all clean-up runs; a second signal ends the process at once.

    Ignored signals (nohup) stay ignored, and only the main thread can handle any.
    """
    before: dict[int, Any] = {}

    def restore() -> None:
        for number, handler in before.items():
            signal.signal(number, handler)

    def stop(number: int, frame: object) -> None:
        restore()
        raise InterruptedSweepError("interrupted: the same command continues from here")

    if threading.current_thread() is threading.main_thread():
        for number in (signal.SIGTERM, signal.SIGHUP):
            if signal.getsignal(number) != signal.SIG_IGN:
                before[number] = signal.signal(number, stop)
    try:
        yield
    finally:
        restore()
