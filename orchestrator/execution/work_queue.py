"""The queue of a stage: cells packed into trials, and what becomes of those whose worker is lost or hangs."""

from __future__ import annotations

import itertools
import math
import time
from collections import defaultdict
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from typing import Any

from orchestrator.planning.search import Tuned
from trainables.agents.registry import agent_named
from trainables.cell import Cell

TARGET_SECONDS = 4.0
"""What a trial should take at least: its start and end cost the driver about a twentieth of a second."""

MOST = 128
"""Most cells of one trial."""

MOST_TRIALS = 20_000
"""Trials of a stage that Tune is trusted with: it keeps each of them, some 20 KB, to the stage's end."""

FIRST_GUESS = 4
"""Tabular cells of one trial as long as none of their kind has been timed."""

LOSSES = 3
"""How often a cell may take its worker with it, without getting any further, before it counts as failed."""

PROGRESS = 0.01
"""Share of a cell that counts as getting further."""


@dataclass(frozen=True)
class Pack:
    """The cells of one trial."""

    cells: tuple[Cell, ...]
    together: bool = False
    """Side by side under a scheduler."""
    asked: tuple[Tuned, str] | None = None
    """The search, and the token of its suggestion."""


@dataclass
class Running:
    """A pack on a worker."""

    pack: Pack
    pid: int | None = None
    node: str | None = None
    since: float | None = None
    """When its present cell began, by the driver's clock; None: its worker is starting."""
    killed: bool = False


@dataclass(frozen=True)
class Ledgered:
    """What the queue asks of, and tells, the ledger."""

    ended: Callable[[Cell], bool]
    score: Callable[[Sequence[Cell]], float | None]
    failed: Callable[[Cell, str, float], None]
    """Takes the failure of a cell that cannot tell it itself: the cell, why, and after how many seconds."""


@dataclass
class WorkQueue:
    """What is left of a stage. One worker has one pack at a time."""

    ledger: Ledgered
    at_once: int | None
    """Most packs at a time; None: as many as the cluster takes."""
    cells: list[Cell] = field(default_factory=list)
    """Small and long ones that run by themselves, the next one last."""
    packs: list[Pack] = field(default_factory=list)
    tuned: Sequence[Tuned] = ()
    together: bool = False
    """Whether suggested configurations run under a scheduler."""
    time_limit: float | None = None
    """Seconds that a cell may take."""
    running: dict[str, Running] = field(default_factory=dict)
    stopping: bool = False
    """Nothing new is handed out any more."""
    _furthest: dict[str, float] = field(default_factory=dict)
    _losses: dict[str, int] = field(default_factory=lambda: defaultdict(int))
    _seconds: dict[tuple[str, str], tuple[int, float]] = field(default_factory=lambda: defaultdict(lambda: (0, 0.0)))

    def __post_init__(self) -> None:
        self._total = len(self.cells)

    def next(self, trial: str) -> Pack | None:
        """The pack of a new trial; None where there is none at the moment (see `over`)."""
        if self.stopping or (self.at_once is not None and len(self.running) >= self.at_once):
            return None
        pack = self._next()
        if pack is not None:
            self.running[trial] = Running(pack)
        return pack

    def over(self) -> bool:
        """Whether no more packs will come."""
        nothing = not self.cells and not self.packs and not any(tuned.left for tuned in self.tuned)
        return not self.running and (self.stopping or nothing)

    def began(self, trial: str, pid: int, node: str) -> None:
        """A pack's worker has started with its first cell."""
        running = self.running[trial]
        running.pid, running.node, running.since = pid, node, time.monotonic()

    def told(self, trial: str, outcomes: Iterable[dict[str, Any]]) -> None:
        """Some cells of a pack have ended, and the next one begins."""
        if trial in self.running:
            self.running[trial].since = time.monotonic()
        for outcome in outcomes:
            kind = outcome["cell"]["agent"], outcome["cell"]["task"]
            count, total = self._seconds[kind]
            self._seconds[kind] = count + 1, total + outcome["seconds"]

    def progressed(self, cell: str, share: float) -> None:
        """A long cell is further than ever: the losses that it has had before were not its fault."""
        if share > self._furthest.get(cell, 0.0) + PROGRESS:
            self._furthest[cell] = share
            self._losses.pop(cell, None)

    def overdue(self) -> list[Running]:
        """The packs whose present cell has taken too long, each once."""
        if self.time_limit is None:
            return []
        now = time.monotonic()
        late = [r for r in self.running.values() if r.since is not None and now - r.since > self.limit(r.pack)]
        late = [running for running in late if not running.killed]
        for running in late:
            running.killed = True
        return late

    def limit(self, pack: Pack) -> float:
        """Seconds that a pack's present cell may take: those of a scheduler's configuration share the worker."""
        assert self.time_limit is not None
        return self.time_limit * (len(pack.cells) if pack.together else 1) + 1.0

    def lost(self, trial: str, why: str) -> None:
        """A worker is gone. Of several cells that are left each goes on alone, which shows whose fault it is."""
        running = self.running.pop(trial, None)
        if running is None or self.stopping:
            return
        left = [cell for cell in running.pack.cells if not self.ledger.ended(cell)]
        if len(left) > 1:
            self.packs += [Pack((cell,), asked=running.pack.asked) for cell in reversed(left)]
            return
        for cell in left:
            seconds = time.monotonic() - (running.since or time.monotonic())
            self._losses[cell.id] += 1
            if running.killed:
                self.ledger.failed(cell, f"it took longer than its time limit of {self.time_limit:g} s", seconds)
            elif self._losses[cell.id] >= LOSSES:
                self.ledger.failed(cell, f"its worker was lost {LOSSES} times, at last: {why}", seconds)
            else:
                self.packs.append(Pack((cell,), asked=running.pack.asked))
        self._tell(running.pack)

    def completed(self, trial: str) -> Pack | None:
        """A trial has ended; its pack, None where `lost` has seen to it already."""
        running = self.running.pop(trial, None)
        if running is None:
            return None
        self._tell(running.pack)
        return running.pack

    def _tell(self, pack: Pack) -> None:
        """Tell a search what became of its suggestion, once all of its cells have ended."""
        if pack.asked is not None:
            tuned, token = pack.asked
            cells = tuned.cells(token)
            if all(self.ledger.ended(cell) for cell in cells):
                tuned.tell(token, self.ledger.score(cells))

    def _next(self) -> Pack | None:
        if self.packs:
            return self.packs.pop()
        if self.cells:
            return Pack(tuple(self.cells.pop() for _ in range(self._size())))
        while open_searches := [tuned for tuned in self.tuned if tuned.left > 0]:
            tuned = max(open_searches, key=lambda candidate: candidate.left)
            token, cells = tuned.suggest()
            missing = tuple(cell for cell in cells if not self.ledger.ended(cell))
            if missing:
                return Pack(missing, self.together, (tuned, token))
            tuned.tell(token, self.ledger.score(cells))
        return None

    def _size(self) -> int:
        """Cells of the next pack: as many of the next one's kind as fill TARGET_SECONDS, but some for every worker."""
        cell = self.cells[-1]
        count, total = self._seconds[cell.agent, cell.task]
        size = FIRST_GUESS if agent_named(cell.agent).kind == "tabular" else 1
        if count:
            size = int(TARGET_SECONDS / max(total / count, 1e-4))
        share = len(self.cells) // (2 * (self.at_once or 2 * len(self.running) + 2))
        size = max(1, min(size, MOST, share), math.ceil(self._total / MOST_TRIALS))
        kind = cell.agent, cell.task
        alike = itertools.takewhile(lambda c: (c.agent, c.task) == kind, reversed(self.cells[-size:]))
        return len(list(alike))
