"""Runs a stage's cells with one `tune.Tuner`, on Ray on this machine or on a cluster."""

from __future__ import annotations

import os
import shutil
import signal
import tempfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from ray import tune
from ray.tune.schedulers import FIFOScheduler, TrialScheduler
from ray.tune.search import Searcher

from orchestrator.cluster import connection, nodes
from orchestrator.cluster.resources import Resources
from orchestrator.execution.executors.monitor import StageMonitor
from orchestrator.execution.interrupt import Interrupt
from trainables.training.ray_tune import METRIC, TIME, run_cells
from trainables.training.worker import WorkerPayload


def run_stage(monitor: StageMonitor, payload: WorkerPayload, resources: Resources, checkpoints: Path | None) -> None:
    """Run the queue as trials of one `tune.Tuner`. checkpoints: the folder in which workers look for STOP, or None."""
    folder = tempfile.mkdtemp(prefix="deltatune-")
    trainable = tune.with_parameters(run_cells, payload=payload)
    with connection.watched_head(monitor.display.abandon), Interrupt(_end_tune, checkpoints) as interrupt:
        tuner = tune.Tuner(
            tune.with_resources(trainable, resources.request()),
            tune_config=tune.TuneConfig(
                search_alg=QueueSearcher(monitor),
                scheduler=EarlyStoppingScheduler(monitor),
                num_samples=-1,
                reuse_actors=True,
                trial_dirname_creator=lambda trial: str(trial.trial_id),
            ),
            run_config=tune.RunConfig(
                storage_path=folder, name="stage", verbose=0, callbacks=[SweepCallback(monitor, interrupt)]
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
    """The queue as a search algorithm of Tune: its packs become trials as workers become free."""

    def __init__(self, monitor: StageMonitor) -> None:
        super().__init__(metric="auc", mode="max")
        self._monitor = monitor

    def suggest(self, trial_id: str) -> Any:
        """Return the config of the next trial, None to wait, or FINISHED."""
        pack = self._monitor.next(trial_id)
        if pack is not None:
            return {"cells": [cell.to_json() for cell in pack.cells], "together": pack.together}
        return Searcher.FINISHED if self._monitor.queue.over() else None

    def on_trial_complete(self, trial_id: str, result: Mapping[str, Any] | None = None, error: bool = False) -> None:
        """Do nothing: SweepCallback informs the queue, which also needs the error."""

    def save(self, checkpoint_path: str) -> None:
        """Do nothing: see _Unsaved."""

    def restore(self, checkpoint_path: str) -> None:
        """Do nothing: see _Unsaved."""


class EarlyStoppingScheduler(_Unsaved, FIFOScheduler):
    """Early stopping within arms as a scheduler of Tune."""

    def __init__(self, monitor: StageMonitor) -> None:
        super().__init__()  # type: ignore[no-untyped-call]
        self._monitor = monitor

    def on_trial_result(self, tune_controller: Any, trial: Any, result: dict[str, Any]) -> str:
        """Return whether a trial continues."""
        if METRIC in result and self._monitor.stops(trial.trial_id, result[TIME], result[METRIC]):
            return str(TrialScheduler.STOP)
        return str(TrialScheduler.CONTINUE)


class SweepCallback(_Unsaved, tune.Callback):
    """Forwards reports to the monitor; handles lost and overdue trials."""

    def __init__(self, monitor: StageMonitor, interrupt: Interrupt) -> None:
        self._monitor, self._interrupt = monitor, interrupt

    def on_trial_result(
        self, iteration: int, trials: list[Any], trial: Any, result: dict[str, Any], **info: Any
    ) -> None:
        """Pass on a report, and remove its data from Tune's result."""
        result["seen"] = True  # Tune prints a line for every trial whose last result has nothing to print
        if report := result.pop("report", None):
            self._monitor.on_report(trial.trial_id, report)

    def on_trial_complete(self, iteration: int, trials: list[Any], trial: Any, **info: Any) -> None:
        """Note that a trial has ended by itself, or by the scheduler."""
        self._monitor.on_completed(trial.trial_id)

    def on_trial_error(self, iteration: int, trials: list[Any], trial: Any, **info: Any) -> None:
        """Note that a trial's worker or node was lost."""
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
