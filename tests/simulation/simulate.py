"""One seed: a sweep that is harmed again and again, and what must be true of it afterwards."""

from __future__ import annotations

import contextlib
import itertools
import json
import random
import shutil
import tempfile
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import greenlet
from rich.console import Console

from orchestrator import clock
from orchestrator.errors import SweepError
from orchestrator.execution import session, stage
from orchestrator.execution.session import SweepSession
from orchestrator.execution.settings import Settings
from orchestrator.model_registry import mlflow_registry
from orchestrator.results import lock
from orchestrator.results.sweep_folder import Results
from orchestrator.tracking import tracker
from orchestrator.tracking.mlflow import mirror
from search_spaces.loading import parse
from search_spaces.search_space import SearchSpace
from tests.simulation.files import Disk, clear
from tests.simulation.mlflow_store import Store, register
from tests.simulation.pure import PURE, Patch, patched
from tests.simulation.workers import TIME_LIMIT, Workers
from tests.simulation.world import Crash, Driver, StuckError, World
from trainables.errors import InputError
from trainables.storage import atomic, disk
from trainables.storage.paths import is_local, storage_path

SHARES = {
    "crash": 0.01,
    "power loss": 0.008,
    "torn write": 0.02,
    "short write": 0.02,
    "lying sync": 0.1,
    "rename that does not last": 0.1,
    "full disk": 0.005,
    "disk error": 0.005,
    "lost answer": 0.02,
    "stale lease": 0.01,
    "clock jump": 0.01,
    "interrupt": 0.003,
    "lost worker": 0.2,
    "late outcome": 0.5,
    "double outcome": 0.2,
    "out of order": 0.2,
    "hung worker": 0.05,
    "MLflow answers 500": 0.1,
    "MLflow does not answer": 0.05,
    "second driver": 0.5,
}
"""How often each fault strikes where it may: at a step, a write, a pack, a call, a life of a driver."""

ON_A_DISK = {"power loss", "torn write", "short write", "lying sync", "rename that does not last"}
ON_A_STORE = {"lost answer", "stale lease"}

LIVES = 3
"""Most lives of a driver that come to harm; the one after them does not."""

BOUND = 3000.0
"""Seconds of virtual time in which a driver without harm must be ready."""

SMALL: dict[str, Any] = {
    "schema": 1,
    "name": "small",
    "family": "tests",
    "seeds": 2,
    "scenarios": [
        {
            "source": {"task": "windy_gridworld", "hyperparameters": {"learning_rate": [0.5, 0.1, 0.2]}},
            "targets": ["windy_gridworld:wind=small"],
        }
    ],
    "hyperparameters": {"episodes": [2], "evaluate_every": [1]},
    "agents": {"q_learning": {}, "delta_gate": {"threshold": [10.0]}},
}

TINY = SMALL | {
    "seeds": 1,
    "scenarios": [SMALL["scenarios"][0] | {"source": {"task": "windy_gridworld"}}],
}
"""The sweep whose every crash point is tried."""

QUIET = Console(quiet=True)

Tables = tuple[list[str], list[str]]


@dataclass(frozen=True)
class Run:
    """What came of a seed."""

    seed: int
    violations: list[str]
    injected: Counter[str]
    lives: int
    seconds: float
    """Of virtual time."""


@lru_cache(maxsize=2)
def space(tiny: bool = False) -> SearchSpace:
    return parse("small", TINY if tiny else SMALL)


def faults_of(rng: random.Random, on_disk: bool) -> dict[str, float]:
    """Any combination of faults."""
    possible = [name for name in SHARES if name not in (ON_A_STORE if on_disk else ON_A_DISK)]
    many = rng.choice((0.15, 0.3, 0.6, 1.0))
    return {name: SHARES[name] * rng.choice((0.3, 1.0, 3.0)) for name in possible if rng.random() < many}


def simulate(seed: int, on_disk: bool | None = None, faults: dict[str, float] | None = None) -> Run:
    """Run a seed."""
    rng = random.Random(f"sweep {seed}")
    on_disk = rng.random() < 0.75 if on_disk is None else on_disk
    world = World(seed, faults_of(rng, on_disk) if faults is None else faults)
    with folder_for(on_disk, seed) as storage, in_virtual_time(world, storage) as (files, store):
        user = User(world, storage, files, store)
        world.spawn(user.live, None)
        try:
            world.go()
            if not world.violations:
                check(world, storage, store)
        except StuckError as error:
            world.violated(f"stuck: {error}")
        finally:
            for task in world.tasks:
                world._at = task
                with contextlib.suppress(Crash, Exception):
                    task.run.throw(greenlet.GreenletExit)
            world._at = None
    return Run(seed, world.violations, world.injected, user.lives, world.now)


class User:
    """Starts a driver after the other, and now and then a second one beside it."""

    def __init__(self, world: World, storage: Path, files: Disk, store: Store, tiny: bool = False) -> None:
        self.world, self.storage, self.files, self.store = world, storage, files, store
        self._space = space(tiny)
        self.lives, self.on_disk = 0, is_local(storage)
        self._numbers = itertools.count(1)

    def live(self) -> None:
        for _ in range(self.world.random.randint(1, LIVES)):
            if self.world.chance("second driver"):
                self.world.spawn(self._second, None)
            if self.life("here") == "done":
                break
        self.finish()

    def finish(self) -> None:
        """Start drivers without harm until the sweep is ready."""
        self.world.calm = True
        began = self.world.now
        for _ in range(10):  # a driver that lives elsewhere is waited for, and what hangs fails once
            if self.life("here", quiet=True) == "done":
                break
            self.world.pause(20.0)
        else:
            self.world.violated("a driver without harm does not come to the end")
        if self.world.now - began > BOUND:
            self.world.violated(f"a driver without harm takes {self.world.now - began:.0f} s")

    def _second(self) -> None:
        self.world.pause(self.world.random.uniform(0, 120))
        self.life("here" if self.on_disk else "there")

    def life(self, machine: str, quiet: bool = False) -> str:
        """One driver, from its start to its end; how that was."""
        world = self.world
        driver = Driver(next(self._numbers), machine, quiet=quiet)
        self.lives += 1
        ends: list[str] = []
        task = world.spawn(lambda: ends.append(self._drive(driver)), driver)
        task.join()
        world.pause(world.random.uniform(0.1, 5.0))
        return ends[0] if ends else "dead"

    def _drive(self, driver: Driver) -> str:
        world, calm = self.world, driver.quiet
        settings = Settings(local=True, workers=3, time_limit=TIME_LIMIT, retry_failed=calm)
        now: SweepSession | None = None
        try:
            with SweepSession.open(
                self.storage, "small", self._space, tracking_uri="sqlite:///simulation", console=QUIET
            ) as now:
                if not world.lied and not world.kept.keys() <= now.results.heads().keys():
                    world.violated("what was recorded is not there any more")
                tally = now.run(settings)
                if tally.left:
                    if not driver.requested:
                        world.violated(f"{tally.left} cells are left by a driver that nobody asked to stop")
                    return "interrupted"
                now.finish(now.results, [])  # type: ignore[arg-type]
                error = now.tracker.error if now.tracker else None
                if "is being written into MLflow by" in str(
                    error
                ):  # the last driver, or its lease: the user tries again
                    return "refused"
                if calm and error is not None:
                    world.violated(f"MLflow is incomplete: {error}")
            return "done"
        except Crash:
            if now is not None and now.tracker is not None:
                with contextlib.suppress(Crash):  # the system frees the locks of a dead process
                    now.tracker._held.close()
            return "dead"
        except InputError as error:
            if "is being run by" not in str(error):
                world.violated(f"refused: {error}")
                return "done"
            world.injected["refused"] += 1
            return "refused"
        except (SweepError, OSError) as error:
            overtaken = "was taken over by" in str(error) and uncertain(world)  # by the last heartbeat of a frozen one
            if calm and not overtaken:
                world.violated(f"failed without harm: {error}")
            return "failed"
        except StuckError:
            raise
        except Exception as error:
            world.violated(f"{type(error).__name__}: {error}")
            return "done"


def tables(results: Results) -> Tables:
    """What the tables say, but for times: a line per row of the cells table, and one per curve."""
    rows = [{k: v for k, v in row.items() if k not in ("seconds", "steps_per_second")} for row in results.rows()]
    points = []
    for _, cell, record in results.records():
        columns = {} if record is None else {k: v for k, v in record.points.items() if k != "seconds"}
        points.append(json.dumps([cell.id, columns]))
    return [json.dumps(row, sort_keys=True) for row in rows], points


def check(world: World, storage: Path, store: Store, tiny: bool = False) -> None:
    """Hold what is there against the promises."""
    results = Results.open(storage, "small")
    there, want = tables(results), undisturbed(tiny)
    if len({json.loads(row)["cell_id"] for row in there[0]}) != len(there[0]):
        world.violated("a cell is twice in the table")
    if there != want:
        world.violated(f"the tables differ: {[row for row in there[0] if row not in want[0]][:2]}")
    if damage := results.damage():
        world.violated(f"the log is damaged: {damage}")
    heads = results.heads()
    if lost := [cell for cell in world.kept if cell not in heads and not world.lied]:
        world.violated(f"recorded and lost: {lost}")
    planned = {cell.id for cells in results.plan().values() for cell in cells}
    if missing := planned - set(store.runs):
        world.violated(f"MLflow lacks {len(missing)} cells")


@lru_cache(maxsize=2)
def undisturbed(tiny: bool = False) -> Tables:
    """The tables of a run without harm."""
    world = World(0, {})
    with folder_for(True, -1) as storage, in_virtual_time(world, storage) as (files, store):
        world.spawn(User(world, storage, files, store, tiny).live, None)
        world.go()
        assert not world.violations, world.violations
        return tables(Results.open(storage, "small"))


@contextlib.contextmanager
def folder_for(on_disk: bool, seed: int) -> Iterator[Path]:
    if not on_disk:
        path = storage_path(f"memory://simulation/{seed}")
        try:
            yield path
        finally:
            clear(path)
        return
    memory = Path("/dev/shm")
    name = tempfile.mkdtemp(prefix="deltatune-simulation-", dir=memory if memory.is_dir() else None)
    try:
        yield Path(name)
    finally:
        shutil.rmtree(name, ignore_errors=True)


@contextlib.contextmanager
def in_virtual_time(world: World, storage: Path) -> Iterator[tuple[Disk, Store]]:
    """Put the world's clock, files, workers and MLflow in place of the real ones."""
    files, store = Disk(world, storage), Store(world)
    world.on_power_loss = files.lose_power

    def executor(settings: Settings) -> Workers:
        made = Workers(settings)
        made.world = world
        return made

    real_me, real_add = lock._me, Results.add

    def me() -> dict[str, Any]:
        return real_me() | {"pid": world.driver.number if world.driver else 0}

    def runs(pid: int, started: object) -> bool:
        return any(task.driver and task.driver.number == pid and not task.driver.dead for task in world.tasks)

    def add(results: Results, *records: Any) -> None:
        """Remember what a driver relies on."""
        real_add(results, *records)
        driver = world.driver
        for record in records:
            if driver is None:
                continue
            if record.cell.id in driver.recorded and record.status != "failed":
                world.violated(f"the cell {record.cell.id} is recorded twice by one driver")
            if record.status == "done":
                driver.recorded.add(record.cell.id)
            if not world.lied and not uncertain(world):
                world.kept[record.cell.id] = record.status

    def token(_: object = None) -> str:
        return f"{world.random.getrandbits(128):032x}"

    patches: list[Patch] = [
        *(
            (clock, name, getattr(world, name))
            for name in ("time", "monotonic", "since_boot", "sleep", "wait", "take", "in_background")
        ),
        *(
            (disk, name, getattr(files, name))
            for name in ("create", "extend", "write", "sync", "truncate", "replace", "remove", "put", "sync_folder")
        ),
        (stage, "executor", executor),
        (session, "stop_now", lambda: setattr(world.driver, "requested", True)),
        (session, "_signals", contextlib.nullcontext),
        (mirror, "Mirror", store.mirror),
        (tracker, "sync", store.sync),
        (mlflow_registry, "register", register),
        (lock, "_me", me),
        (lock, "machine", lambda: world.driver.machine if world.driver else ""),
        (lock, "runs", runs),
        (lock, "uuid", SimpleNamespace(uuid4=lambda: SimpleNamespace(hex=token()))),
        (atomic, "secrets", SimpleNamespace(token_hex=lambda size: token()[: 2 * size])),
        (Results, "add", add),
        *PURE,
    ]
    with patched(patches):
        yield files, store


def uncertain(world: World) -> bool:
    """Return whether two drivers may both believe that they hold the sweep: a lease can be lost unknown."""
    return bool(world.faults.get("stale lease"))
