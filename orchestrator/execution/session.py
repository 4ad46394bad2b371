"""A sweep's session: the lock first, then its files; on every way out the tracker's status, the lock and a sentence."""

from __future__ import annotations

import logging
import signal
import threading
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rich.console import Console

from orchestrator.errors import InterruptedSweepError, LeaseLostError, SweepError
from orchestrator.execution.interrupt import stop_now
from orchestrator.execution.settings import RunSummary, Settings
from orchestrator.execution.sweep import run_held
from orchestrator.model_registry import pretrained
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
    """One driver at one sweep, from `open` to the end of the block."""

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
        """Open the sweep `name` in `storage`, new or grown by `space`: take its lock, then write what it is to be.

        sources: pretrained ones, in place of training them. tracking_uri: the tracker to write to; None: none.
        A driver that is refused (InputError: another one is at it, or the folder is another search space's) changes
        nothing. When the block is left, in whatever way, the tracker says how it ended and the lock is free; an error
        is followed by a sentence that says where things are.
        """
        console = console or Console(quiet=True)
        results = Results.prepare(storage, name)
        with _signals(), locked(results.folder, on_lost=stop_now) as hold, logging_to(results.folder):
            results.log.guard(hold)
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

    def run(self, settings: Settings, meanwhile: Callable[[], object] = lambda: None) -> RunSummary:
        """Run what is missing; see `run_held`. A tally with `left` is of a run that was interrupted.

        meanwhile: called in a thread of its own when the first cell has ended, to import what the end needs, say.
        """
        begun: list[threading.Thread] = []

        def record(stage: str, record: Record) -> None:
            if not begun:
                begun.append(threading.Thread(target=_quietly, args=(meanwhile,), name="meanwhile", daemon=True))
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
        """Write what came of the sweep into its tracker, sources into MLflow's registry too; the registered models.

        What it does not take is told by `tracker.error`: the results are whole without it.
        """
        if self.tracker is None:
            return []
        parent = self.tracker.finish(findings, artifacts)
        self._ended = True
        if parent is None or not self.tracker.kind.has_registry:
            return []
        from orchestrator.model_registry.mlflow_registry import register

        try:
            return register(self.results, self.tracker.uri, parent)
        except Exception as error:
            log.warning("the sources are not in MLflow's registry: %s: %s", type(error).__name__, error)
            self.tracker.error = error
            return []

    def _left_by(self, error: BaseException) -> None:
        """Note an error that ends the session: in the tracker, and in a sentence where it is not the user's input."""
        stopped = isinstance(error, KeyboardInterrupt | InterruptedSweepError)
        known = self._ended
        self._end("KILLED" if stopped else "FAILED")
        if known or isinstance(error, InputError) or not isinstance(error, Exception | KeyboardInterrupt):
            return
        log.error("the sweep has failed", exc_info=error)
        with suppress(Exception):
            there = len(self.results.heads())
            self._console.print(
                f"{there} cells have ended and are kept in {self.results.folder}; the same command goes on from there",
                soft_wrap=True,
            )

    def _end(self, status: str) -> None:
        """Give the tracker a status, once; not where the sweep is another driver's by now."""
        if not self._ended and self.tracker is not None:
            self.tracker.stop(None if self._hold.lost else status)
        self._ended = True


def _quietly(work: Callable[[], object]) -> None:
    """Do what may fail: whoever needs it fails then, and says so."""
    try:
        work()
    except Exception as error:
        log.info("%s: %s", type(error).__name__, error)


@contextmanager
def _signals() -> Iterator[None]:
    """Turn SIGTERM and SIGHUP into an error, so that every way out is gone; a second one ends the process at once.

    A signal that is ignored (by nohup, say) stays so, and only the main thread can take any.
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
