"""Virtual time: tasks that take turns, drivers that may die at any step, and the seed that decides all of it."""

from __future__ import annotations

import queue
import random
import threading
from collections import Counter
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, field
from typing import Any

import greenlet

MAX_TURNS = 200_000
"""Turns after which a run is taken for stuck."""

EPOCH = 1_700_000_000.0


class Crash(BaseException):
    """A driver is dead: nothing that it does from here on has an effect."""


class StuckError(Exception):
    """Nothing goes on any more."""


@dataclass
class Driver:
    """A process that runs a sweep."""

    number: int
    machine: str
    dead: bool = False
    requested: bool = False
    """Whether it is to stop: by a signal, or as its lease is lost."""
    frozen: float = 0.0
    """Until when its process does not run."""
    quiet: bool = False
    """Whether no harm comes to it."""
    recorded: set[str] = field(default_factory=set)
    """Cells that it has recorded as done."""


@dataclass(eq=False)
class Task:
    """Something that runs: a thread of a driver, or a user who starts drivers."""

    world: World
    driver: Driver | None
    run: Any
    wake: float = 0.0
    ready: Callable[[], bool] | None = None

    def join(self) -> None:
        """Wait until it has ended."""
        self.world.pause(float("inf"), lambda: bool(self.run.dead))


class World:
    """One simulated run."""

    def __init__(self, seed: int, faults: dict[str, float]) -> None:
        self.random = random.Random(seed)
        self.faults, self.calm = faults, False
        self.now, self.turns = 0.0, 0
        self.jumps: dict[str, float] = {}
        self.injected: Counter[str] = Counter()
        self.violations: list[str] = []
        self.lied = False
        """Whether the disk has said that it keeps what it does not."""
        self.kept: dict[str, str] = {}
        """Cell to the status that a driver has recorded and relied on."""
        self.tasks: list[Task] = []
        self._hub = greenlet.getcurrent()
        self._at: Task | None = None
        self.on_power_loss: Callable[[], None] = lambda: None

    @property
    def driver(self) -> Driver | None:
        """The driver whose code runs now."""
        return self._at.driver if self._at else None

    def spawn(self, work: Callable[[], None], driver: Driver | None) -> Task:
        """Start a task."""
        task = Task(self, driver, greenlet.greenlet(work, self._hub), self.now)
        self.tasks.append(task)
        return task

    def pause(self, seconds: float, ready: Callable[[], bool] | None = None) -> None:
        """Let the others run for some time, or until something is so."""
        task = self._at
        if task is None:
            self.now += seconds if seconds < float("inf") else 0.0
            return
        if task.driver and task.driver.dead:
            raise Crash
        if ready is not None and ready():
            return
        task.wake, task.ready = self.now + seconds, ready
        self._hub.switch()

    def go(self) -> None:
        """Run until all tasks have ended."""
        while self.tasks:
            self.turns += 1
            if self.turns > MAX_TURNS:
                raise StuckError(f"after {self.now:.0f} s of virtual time it does not end")
            ready = [task for task in self.tasks if self._due(task)]
            if ready:
                self._turn(self.random.choice(ready) if len(ready) > 1 else ready[0])
                continue
            later = min(max(task.wake, task.driver.frozen if task.driver else 0.0) for task in self.tasks)
            if later == float("inf"):
                raise StuckError("every task waits for another")
            self.now = max(self.now, later)

    def _due(self, task: Task) -> bool:
        if task.driver and task.driver.frozen > self.now:
            return False
        return task.wake <= self.now or (task.ready is not None and task.ready())

    def _turn(self, task: Task) -> None:
        self._at, task.wake, task.ready = task, float("inf"), None
        task.run.switch()
        self._at = None
        for driver in {
            id(each.driver): each.driver for each in self.tasks if each.driver and each.driver.dead
        }.values():
            self._bury(driver)
        self.tasks = [each for each in self.tasks if not each.run.dead]

    def _bury(self, driver: Driver) -> None:
        """End the other threads of a dead driver."""
        for other in [task for task in self.tasks if task.driver is driver]:
            self._at = other
            with suppress(Crash):  # one that has not begun passes it on
                while not other.run.dead:
                    other.run.throw(Crash)
            self._at = None
        self.tasks = [task for task in self.tasks if task.driver is not driver]

    def chance(self, fault: str) -> bool:
        """Return whether a fault strikes now."""
        share = self.faults.get(fault)
        if not share or self.calm or (self._at and self._at.driver and self._at.driver.quiet):
            return False
        struck = self.random.random() < share
        if struck:
            self.injected[fault] += 1
        return struck

    def step(self) -> None:
        """A moment between two steps of a driver: it may die or be frozen here, and others may go on."""
        driver = self.driver
        if driver is None:
            return
        if driver.dead:
            raise Crash
        if self.chance("crash"):
            self.die()
        if self.chance("power loss"):
            self.on_power_loss()
            for each in self.tasks:  # all that run on the machine
                if each.driver:
                    each.driver.dead = True
            self.die()
        if self.chance("stale lease"):
            driver.frozen = self.now + self.random.uniform(20, 400)
            self.pause(0.0)
        elif self.random.random() < 0.2:
            self.pause(self.random.choice((0.0, 0.0, 0.001)))
        if self.chance("clock jump"):
            self.jumps[driver.machine] = self.random.choice((-1e6, -3600.0, -70.0, 30.0, 3600.0, 1e6))
        if self.chance("interrupt"):
            driver.requested = True

    def die(self) -> None:
        """End the driver that runs."""
        assert self.driver is not None
        self.driver.dead = True
        raise Crash

    def violated(self, text: str) -> None:
        """Note a promise that was broken."""
        self.violations.append(f"{self.now:.1f} s: {text}")

    # The clock.

    def time(self) -> float:
        return EPOCH + self.now + self.jumps.get(self.driver.machine if self.driver else "", 0.0)

    def monotonic(self) -> float:
        return self.now

    since_boot = monotonic

    def sleep(self, seconds: float) -> None:
        self.pause(seconds)

    def wait(self, event: threading.Event, seconds: float) -> bool:
        self.pause(seconds, event.is_set)
        return event.is_set()

    def take(self, items: queue.Queue[Any], seconds: float) -> Any:
        self.pause(seconds, lambda: not items.empty())
        return items.get_nowait()

    def in_background(self, work: Callable[[], None], name: str) -> Task:
        def guarded() -> None:
            try:
                work()
            except Crash:
                pass
            except Exception as error:
                self.violated(f"the thread {name} has ended by {type(error).__name__}: {error}")

        return self.spawn(guarded, self.driver)
