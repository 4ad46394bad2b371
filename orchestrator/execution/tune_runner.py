"""One stage's cells through one `tune.Tuner`."""

from __future__ import annotations

import shutil
import tempfile
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ray import tune
from ray.tune.search import Searcher

from orchestrator.cluster import nodes
from orchestrator.cluster.resources import Resources
from orchestrator.execution.display import Display
from orchestrator.execution.early_stopping import ArmSchedulers
from orchestrator.execution.interrupt import Interrupt
from orchestrator.execution.work_queue import WorkQueue
from trainables import curve
from trainables.plugins import loader
from trainables.training.cell_run import Outcome, stopped
from trainables.training.ray_tune import run_cells

Take = Callable[[list[Outcome]], None]
"""Takes over the outcomes of cells that have ended."""


@dataclass(frozen=True)
class Shipment:
    """What goes to every worker of a stage."""

    sources: Mapping[str, Mapping[str, Any]]
    """The arrays of each source, by `Cell.source_key`."""
    keep: bool
    """Whether what each cell has learned is wanted."""
    checkpoints: Path | None
    """The folder for the states of long cells; None: a worker that is lost costs its cell's work."""
    checkpoint_seconds: float
    """Time between the checkpoints of a cell."""


class Proposals(Searcher):
    """The queue as a Tune search algorithm: its packs become trials as workers get free."""

    def __init__(self, queue: WorkQueue) -> None:
        super().__init__(metric="auc", mode="max")
        self._queue = queue

    def __getstate__(self) -> dict[str, Any]:
        """Nothing to save: a sweep resumes from its records, never from Tune's."""
        return {}

    def suggest(self, trial_id: str) -> Any:
        """The config of the next trial, None to wait, or FINISHED."""
        pack = self._queue.next(trial_id)
        if pack is not None:
            return {"cells": [cell.to_json() for cell in pack.cells], "together": pack.together}
        return Searcher.FINISHED if self._queue.over() else None

    def on_trial_complete(self, trial_id: str, result: Mapping[str, Any] | None = None, error: bool = False) -> None:
        """Nothing: the Relay tells the queue, which needs the error too."""

    def save(self, checkpoint_path: str) -> None:
        """Nothing: see `__getstate__`."""

    def restore(self, checkpoint_path: str) -> None:
        """Nothing: see `__getstate__`."""


class Relay(tune.Callback):
    """Hands what trials report to the queue and to the driver, and sees to those that are lost or take too long."""

    def __init__(
        self, queue: WorkQueue, take: Take, display: Display, schedulers: ArmSchedulers | None, interrupt: Interrupt
    ) -> None:
        self._queue, self._take, self._display = queue, take, display
        self._schedulers, self._interrupt = schedulers, interrupt
        self._points: dict[str, Mapping[str, Any]] = {}

    def __getstate__(self) -> dict[str, Any]:
        """Nothing to save: a sweep resumes from its records, never from Tune's."""
        return {}

    def on_trial_result(
        self, iteration: int, trials: list[Any], trial: Any, result: dict[str, Any], **info: Any
    ) -> None:
        """Take over what a report brings, and free Tune of its weight."""
        result["seen"] = True  # Tune prints a line for every trial whose last result has nothing to print
        if worker := result.pop("worker", None):
            self._queue.began(trial.trial_id, **worker)
        if progress := result.pop("progress", None):
            self._display.progress(**progress)
            self._queue.progressed(progress["cell"], progress["share"])
        for cell_id, points in result.pop("points", ()):
            self._points[cell_id] = curve.joined(self._points.get(cell_id, {}), points)
        if outcomes := result.pop("ended", None):
            self._queue.told(trial.trial_id, outcomes)
            self._take(outcomes)

    def on_trial_complete(self, iteration: int, trials: list[Any], trial: Any, **info: Any) -> None:
        """A trial has ended by itself, or a scheduler has ended it."""
        reason = self._schedulers.stopped.get(trial.trial_id) if self._schedulers else None
        running = self._queue.running.get(trial.trial_id)
        if running is not None and reason:
            cells = [cell for cell in running.pack.cells if cell.id in self._points]
            self._take([stopped(cell, reason, dict(self._points.pop(cell.id))) for cell in cells])
        self._queue.completed(trial.trial_id)

    def on_trial_error(self, iteration: int, trials: list[Any], trial: Any, **info: Any) -> None:
        """A trial's worker or node was lost."""
        why = _cause(trial.error_file)
        self._display.note(f"a worker was lost: {why}")
        if running := self._queue.running.get(trial.trial_id):
            for cell in running.pack.cells:
                self._display.over(cell.id)
        self._queue.lost(trial.trial_id, why)

    def on_step_end(self, iteration: int, trials: list[Any], **info: Any) -> None:
        """Count the running trials, see to those that take too long, and to a wish to stop."""
        self._display.running(len(self._queue.running))
        for running in self._queue.overdue():
            assert running.node is not None
            assert running.pid is not None
            nodes.kill(running.node, running.pid)
        if self._interrupt.asked:
            self._queue.stopping = True
            if not self._queue.running:
                self._interrupt.now()


def run_stage(
    queue: WorkQueue,
    shipment: Shipment,
    resources: Resources,
    take: Take,
    display: Display,
    schedulers: ArmSchedulers | None = None,
) -> None:
    """Run a stage, handing each outcome to `take`. What an interrupt has left is still in the queue."""
    folder = tempfile.mkdtemp(prefix="deltatune-")
    trainable = tune.with_parameters(
        run_cells,
        sources=dict(shipment.sources),
        keep=shipment.keep,
        checkpoints=str(shipment.checkpoints) if shipment.checkpoints else None,
        checkpoint_seconds=shipment.checkpoint_seconds,
        own=loader.packed(),
    )
    with Interrupt(shipment.checkpoints) as interrupt:
        tuner = tune.Tuner(
            tune.with_resources(trainable, resources.request()),
            tune_config=tune.TuneConfig(
                search_alg=Proposals(queue),
                scheduler=schedulers,
                num_samples=-1,
                reuse_actors=True,
                trial_dirname_creator=lambda trial: str(trial.trial_id),
            ),
            run_config=tune.RunConfig(
                storage_path=folder,
                name="stage",
                verbose=0,
                callbacks=[Relay(queue, take, display, schedulers, interrupt)],
            ),
        )
        try:
            tuner.fit()
        finally:
            shutil.rmtree(folder, ignore_errors=True)


def _cause(error_file: str | None) -> str:
    """Why a worker was lost, in a sentence, from what Tune has noted of it."""
    try:
        text = Path(error_file or "").read_text(encoding="utf-8")
    except OSError:
        text = ""
    if "OutOfMemory" in text or "running low on memory" in text:
        return "its node ran out of memory; fewer --workers, or --memory-per-cell, leave each cell more"
    told = [line.strip() for line in text.splitlines() if line.strip()]
    for line in told:
        if line.startswith("ray.exceptions.") or "Error: " in line:
            return line.removeprefix("ray.exceptions.")[:500]
    return told[-1][:500] if told else "nothing is known of the cause"
