"""MLflow as far as the tracker sees it: a store that answers 500, or not at all, or has taken what it refused."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from functools import partial
from typing import Any

from orchestrator.results.records.record import Head, Record
from orchestrator.results.sweep_folder import Results
from tests.simulation.world import World


class Store:
    """The runs of all sweeps."""

    def __init__(self, world: World) -> None:
        self.world = world
        self.runs: dict[str, str] = {}
        self.status = ""

    def call(self, effect: Callable[[], None] = lambda: None) -> None:
        """Any request: it reaches the store at once, whatever becomes of its sender, or not at all."""
        world = self.world
        if world.chance("MLflow does not answer"):
            world.pause(world.random.uniform(10, 120))
            raise TimeoutError("no answer")
        if world.chance("MLflow answers 500"):
            world.pause(0.01)
            raise RuntimeError("500 Internal Server Error")
        effect()
        world.pause(0.01)

    def mirror(self, results: Results, uri: str, check: Callable[[], None]) -> Mirror:
        return Mirror(self, check)

    def sync(self, findings: Results, uri: str, artifacts: object, mirror: Mirror) -> str:
        """As `tracking.sync` writes the cells."""
        for stage, cell, head in findings.planned_heads():
            if head is not None:
                mirror.write_cell(stage, head, partial(findings.log.record, cell.id))
        mirror.end("FINISHED")
        return "parent"


class Mirror:
    """What one process knows of the store."""

    def __init__(self, store: Store, check: Callable[[], None]) -> None:
        self._store, self._check = store, check
        check()
        store.call()
        self._known = dict(store.runs)

    def write_cell(self, stage: str, head: Head, read: Callable[[], Record | None]) -> None:
        key, store = head.cell.id, self._store
        if self._known.get(key) == head.digest or (record := read()) is None:
            return

        def write() -> None:
            if key in store.runs and key not in self._known:
                store.world.violated(f"MLflow gets a second run of the cell {key}")
            store.runs[key] = self._known[key] = record.digest

        self._check()
        store.call(write)
        store.call()  # what it has taken may seem to have failed

    def end(self, status: str) -> None:
        self._check()
        self._store.call()
        self._store.status = status


def register(*words: Any) -> Iterable[str]:
    """Take the place of the registry."""
    return []
