"""The executor that runs cells on Ray, on this machine or on a cluster."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from contextlib import ExitStack
from importlib import import_module
from pathlib import Path

from rich.console import Console

from orchestrator.cluster import connection, nodes
from orchestrator.execution.executors.executor import StageRun, Workplace
from orchestrator.execution.settings import Settings
from trainables.storage.folders import make_folder

RUNNER = "orchestrator.execution.executors.tune_runner"
"""Imports Ray Tune, which takes about as long as starting Ray; both happen at the same time."""


class RayExecutor:
    """Runs packs as trials of Ray Tune, over one connection to Ray."""

    def __init__(self, settings: Settings) -> None:
        self._settings = settings
        self._checkpoints: Path | None = None

    def open(self, checkpoints: Path, console: Console, stack: ExitStack) -> Workplace:
        """Connect to Ray, and return its capacity and the folder for checkpoints."""
        settings, resources = self._settings, self._settings.resources
        threading.Thread(target=import_module, args=(RUNNER,), daemon=True).start()
        with console.status("starting Ray"):
            stack.enter_context(connection.connected(settings.workers, settings.address, resources))
            fits = nodes.capacity(resources, nodes.NODE_PATIENCE if settings.address else 0.0)
            workers = min(settings.workers or fits, fits)
            self._checkpoints = make_folder(checkpoints)
            if blind := nodes.nodes_without_storage(checkpoints):
                self._checkpoints = None
                console.print(f"no checkpoints: {', '.join(blind)} cannot see {checkpoints}", style="yellow")
        return Workplace(workers, settings.workers or (None if settings.address else workers), self._checkpoints)

    def run(self, stages: Iterator[StageRun]) -> None:
        """Run all stages by one `tune.Tuner`."""
        import_module(RUNNER).run(stages, self._settings.resources, self._checkpoints)
