"""Runs a sweep's cells with one `tune.Tuner`, on Ray on this machine or on a cluster."""

from __future__ import annotations

import os
import shutil
import signal
import tempfile
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from ray import tune
from ray.tune.schedulers import FIFOScheduler, TrialScheduler
from ray.tune.search import Searcher

from orchestrator.cluster import connection, nodes
from orchestrator.cluster.resources import Resources
from orchestrator.execution.executors.executor import StageRun
from orchestrator.execution.executors.monitor import StageMonitor
from orchestrator.execution.executors.trials import Trials
from orchestrator.execution.interrupt import Interrupt
from trainables.training.tune_worker import HOLD, METRIC, TIME, run_cells


def run(stages: Iterator[StageRun], resources: Resources, checkpoints: Path | None) -> None:
    """Run all stages as one `tune.Tuner`. checkpoints: the folder in which workers look for STOP, or None."""
    if (first := next(stages, None)) is None:
        return
    interrupt = Interrupt(_end_tune, checkpoints)
    trials = Trials(first, stages, lambda: interrupt.requested)
    with connection.watched_head(lambda address: trials.monitor.display.abandon(address)), interrupt:
        _fit(trials, interrupt, resources)
    trials.finish()


def _fit(trials: Trials, interrupt: Interrupt, resources: Resources) -> None:
    folder = tempfile.mkdtemp(prefix="deltatune-")
    tuner = tune.Tuner(
        tune.with_resources(run_cells, resources.request()),
        tune_config=tune.TuneConfig(
            search_alg=QueueSearcher(trials),
            scheduler=EarlyStoppingScheduler(trials),
            num_samples=-1,
            reuse_actors=True,
            trial_dirname_creator=lambda trial: str(trial.trial_id),
        ),
        run_config=tune.RunConfig(
            storage_path=folder, name="sweep", verbose=0, callbacks=[SweepCallback(trials, interrupt)]
        ),
    )
    try:
        tuner.fit()
    finally:
        shutil.rmtree(folder, ignore_errors=True)


class _Unsaved:
    """Has no state that Tune could save, since a sweep resumes from its records."""

    def __getstate__(self) -> dict[str, Any]:
        return {}


class QueueSearcher(_Unsaved, Searcher):
    """The queues as a search algorithm of Tune: their packs become trials as workers become free."""

    def __init__(self, trials: Trials) -> None:
        super().__init__(metric="auc", mode="max")
        self._trials = trials

    def suggest(self, trial_id: str) -> Any:
        """Return the config of the next trial, None to wait, or FINISHED."""
        config = self._trials.next(trial_id)
        return Searcher.FINISHED if config is None and self._trials.over else config

    def on_trial_complete(self, trial_id: str, result: Mapping[str, Any] | None = None, error: bool = False) -> None:
        """Do nothing: SweepCallback informs the queue, which also needs the error."""

    def save(self, checkpoint_path: str) -> None:
        """Do nothing: see _Unsaved."""

    def restore(self, checkpoint_path: str) -> None:
        """Do nothing: see _Unsaved."""


class EarlyStoppingScheduler(_Unsaved, FIFOScheduler):
    """Early stopping within arms as a scheduler of Tune."""

    def __init__(self, trials: Trials) -> None:
        super().__init__()  # type: ignore[no-untyped-call]
        self._trials = trials

    def on_trial_result(self, tune_controller: Any, trial: Any, result: dict[str, Any]) -> str:
        """Return whether a trial continues."""
        if HOLD in result:
            return str(TrialScheduler.CONTINUE if self._trials.holds(trial.trial_id) else TrialScheduler.STOP)
        if METRIC in result and self._trials.monitor.stops(trial.trial_id, result[TIME], result[METRIC]):
            return str(TrialScheduler.STOP)
        return str(TrialScheduler.CONTINUE)


class SweepCallback(_Unsaved, tune.Callback):
    """Forwards reports to the monitor; handles lost and overdue trials."""

    def __init__(self, trials: Trials, interrupt: Interrupt) -> None:
        self._trials, self._interrupt = trials, interrupt

    @property
    def _monitor(self) -> StageMonitor:
        return self._trials.monitor

    def on_trial_result(
        self, iteration: int, trials: list[Any], trial: Any, result: dict[str, Any], **info: Any
    ) -> None:
        """Pass on a report, and remove its data from Tune's result."""
        result["seen"] = True  # Tune prints a line for every trial whose last result has nothing to print
        if report := result.pop("report", None):
            self._monitor.on_report(trial.trial_id, report)

    def on_trial_complete(self, iteration: int, trials: list[Any], trial: Any, **info: Any) -> None:
        """Note that a trial has ended by itself, or by the scheduler."""
        self._trials.let_go(trial.trial_id)
        self._monitor.on_completed(trial.trial_id)

    def on_trial_error(self, iteration: int, trials: list[Any], trial: Any, **info: Any) -> None:
        """Note that a trial's worker or node was lost."""
        self._trials.let_go(trial.trial_id)
        self._monitor.on_lost(trial.trial_id, _cause(trial.error_file))

    def on_step_end(self, iteration: int, trials: list[Any], **info: Any) -> None:
        """End overdue workers, and act on a request to stop."""
        for running in self._monitor.overdue():
            assert running.node is not None
            assert running.pid is not None
            nodes.kill(running.node, running.pid)
        if self._interrupt.requested:
            queue = self._monitor.queue
            queue.stopping = True
            if not queue.running:
                _end_tune()


def _end_tune() -> None:
    """Make Tune end the stage at once, by SIGUSR1, for which it listens while a stage runs."""
    if signal.getsignal(signal.SIGUSR1) not in (signal.SIG_DFL, signal.SIG_IGN):
        os.kill(os.getpid(), signal.SIGUSR1)


def _cause(error_file: str | None) -> str:
    """Return why a worker was lost, in a sentence, from Tune's error file."""
    try:
        text = Path(error_file or "").read_text(encoding="utf-8")
    except OSError:
        text = ""
    if "OutOfMemory" in text or "running low on memory" in text:
        return "its node ran out of memory; fewer --workers, or --memory-per-cell, leave each cell more"
    lines = [line.strip() for line in text.splitlines() if line.strip()]
    for line in lines:
        if line.startswith("ray.exceptions.") or "Error: " in line:
            return line.removeprefix("ray.exceptions.")[:500]
    return lines[-1][:500] if lines else "the cause is unknown"
