"""The interface of executors, which run the cells of a stage. All of them give the same bits and files."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import ExitStack
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import Protocol

from rich.console import Console

from orchestrator.execution.executors.monitor import StageMonitor
from orchestrator.execution.settings import Settings
from trainables.training.messages import WorkerPayload


@dataclass(frozen=True)
class Workplace:
    """The capacity of an open executor."""

    workers: int
    """Cells that run at a time."""
    at_once: int | None
    """Packs handed out at a time; None: as many as an autoscaling cluster takes."""
    checkpoints: Path | None
    """The folder for checkpoints, which all workers can read; None: no checkpoints."""


@dataclass(frozen=True)
class StageRun:
    """A stage that is to run now."""

    monitor: StageMonitor
    payload: WorkerPayload
    followed: bool
    """Whether another stage may follow, for which workers are worth keeping."""


class Executor(Protocol):
    """Runs stages one after the other."""

    def open(self, checkpoints: Path, console: Console, stack: ExitStack) -> Workplace:
        """Prepare before the first stage; `stack` closes at the sweep's end. Raises InputError where that fails."""

    def run(self, stages: Iterator[StageRun]) -> None:
        """Run the packs of each stage's queue and report to its monitor; workers stay from one stage to the next.

        Asking for the next stage ends the one before and plans the next; it raises InterruptedSweepError where packs
        are left. An interrupt leaves the rest in the queue.
        """


def executor(settings: Settings) -> Executor:
    """Return the executor that the settings ask for. Ray is imported only for its own executor."""
    if not settings.local:
        module, name = "orchestrator.execution.executors.ray_executor", "RayExecutor"
    elif settings.workers == 1 and settings.time_limit is None:
        module, name = "orchestrator.execution.executors.in_process", "InProcessExecutor"
    else:
        module, name = "orchestrator.execution.executors.process_pool", "ProcessPoolExecutor"
    made: Callable[[Settings], Executor] = getattr(import_module(module), name)
    return made(settings)
