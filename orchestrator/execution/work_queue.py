"""The queue of a stage: packs cells into trials, and decides on those whose worker is lost or hangs.

It reads the state of cells and returns what must fail; it never writes.
"""

from __future__ import annotations

import itertools
import math
from collections import defaultdict
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from orchestrator import clock
from trainables.agents.registry import agent_named
from trainables.cell import Cell
from trainables.training.cell_run import Outcome

if TYPE_CHECKING:
    from orchestrator.planning.search import Tuned

TARGET_SECONDS = 4.0
"""What a trial should take at least: its start and end cost the driver about a twentieth of a second."""

MAX_PACK_SIZE = 128
"""Cells of one trial at most."""

MAX_TRIALS = 20_000
"""Trials of a stage that Tune is trusted with: it keeps each of them, some 20 KB, to the stage's end."""

FIRST_GUESS = 4
"""Tabular cells of one trial as long as none of their kind has been timed."""

MAX_WORKER_LOSSES = 3
"""Worker losses without progress after which a cell fails."""

MIN_PROGRESS = 0.01
"""Share of a cell that counts as progress."""


@dataclass(frozen=True)
class Pack:
    """The cells of one trial."""

    cells: tuple[Cell, ...]
    together: bool = False
    """Side by side under a scheduler."""


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
class CellStatus:
    """Callbacks through which the queue asks for the state of cells."""

    ended: Callable[[Cell], bool]
    score: Callable[[Sequence[Cell]], float | None]


@dataclass(frozen=True)
class LostOutcome:
    """A cell that must fail: its worker is gone for good, and cannot report it."""

    cell: Cell
    error: str
    seconds: float


@dataclass
class WorkQueue:
    """What is left of a stage. One worker has one pack at a time."""

    status: CellStatus
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
    _unsettled: dict[tuple[int, str], tuple[Tuned, str]] = field(default_factory=dict)
    """Suggestions whose cells were on a worker, until all of them have ended."""
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

    def on_started(self, trial: str, pid: int, node: str) -> None:
        """A pack's worker has started with its first cell; nothing where it was given up before that was told."""
        if (running := self.running.get(trial)) is None:
            return
        running.pid, running.node, running.since = pid, node, clock.monotonic()

    def on_outcomes(self, trial: str, outcomes: Iterable[Outcome]) -> None:
        """Some cells of a pack have ended, and the next one begins."""
        if trial in self.running:
            self.running[trial].since = clock.monotonic()
        for outcome in outcomes:
            kind = outcome.cell.agent, outcome.cell.task
            count, total = self._seconds[kind]
            self._seconds[kind] = count + 1, total + outcome.seconds

    def on_progress(self, cell: str, share: float) -> None:
        """A long cell is further than ever: the losses that it has had before were not its fault."""
        if share > self._furthest.get(cell, 0.0) + MIN_PROGRESS:
            self._furthest[cell] = share
            self._losses.pop(cell, None)

    def overdue(self) -> list[Running]:
        """The packs whose present cell has taken too long, each once."""
        if self.time_limit is None:
            return []
        now = clock.monotonic()
        late = [r for r in self.running.values() if r.since is not None and now - r.since > self.limit(r.pack)]
        late = [running for running in late if not running.killed]
        for running in late:
            running.killed = True
        return late

    def limit(self, pack: Pack) -> float:
        """Seconds that a pack's present cell may take: those of a scheduler's configuration share the worker."""
        assert self.time_limit is not None
        return self.time_limit * (len(pack.cells) if pack.together else 1) + 1.0

    def on_lost(self, trial: str, why: str) -> list[LostOutcome]:
        """A worker is gone; return the cells that must fail, which the caller persists.

        Of several cells that are left each goes on alone, which shows whose fault it is.
        """
        running = self.running.pop(trial, None)
        if running is None or self.stopping:
            return []
        left = [cell for cell in running.pack.cells if not self.status.ended(cell)]
        if len(left) > 1:
            self.packs += [Pack((cell,)) for cell in reversed(left)]
            return []
        failures = [failure for cell in left if (failure := self._lost(cell, running, why)) is not None]
        if not failures:
            self.packs += [Pack((cell,)) for cell in left]
        return failures

    def _lost(self, cell: Cell, running: Running, why: str) -> LostOutcome | None:
        """Count a loss of the cell's worker; its failure, or None where it may be tried again."""
        seconds = clock.monotonic() - (running.since or clock.monotonic())
        self._losses[cell.id] += 1
        if running.killed:
            return LostOutcome(cell, f"it took longer than its time limit of {self.time_limit:g} s", seconds)
        if self._losses[cell.id] >= MAX_WORKER_LOSSES:
            return LostOutcome(cell, f"its worker was lost {MAX_WORKER_LOSSES} times, at last: {why}", seconds)
        return None

    def on_completed(self, trial: str) -> None:
        """A trial has ended. Nothing where `on_lost` has seen to it already."""
        self.running.pop(trial, None)

    def _settle(self) -> None:
        """Tell searches what became of the suggestions whose cells have all ended."""
        for key, (tuned, token) in list(self._unsettled.items()):
            cells = tuned.cells(token)
            if all(self.status.ended(cell) for cell in cells):
                del self._unsettled[key]
                tuned.tell(token, self.status.score(cells))

    def _next(self) -> Pack | None:
        self._settle()
        if self.packs:
            return self.packs.pop()
        if self.cells:
            return Pack(tuple(self.cells.pop() for _ in range(self._size())))
        while open_searches := [tuned for tuned in self.tuned if tuned.left > 0]:
            tuned = max(open_searches, key=lambda candidate: candidate.left)
            token, cells = tuned.suggest()
            missing = tuple(cell for cell in cells if not self.status.ended(cell))
            if missing:
                self._unsettled[id(tuned), token] = tuned, token
                return Pack(missing, self.together)
            tuned.tell(token, self.status.score(cells))
        return None

    def _size(self) -> int:
        """Cells of the next pack: as many of the next one's kind as fill TARGET_SECONDS, but some for every worker."""
        cell = self.cells[-1]
        count, total = self._seconds[cell.agent, cell.task]
        size = FIRST_GUESS if agent_named(cell.agent).kind == "tabular" else 1
        if count:
            size = int(TARGET_SECONDS / max(total / count, 1e-4))
        share = len(self.cells) // (2 * (self.at_once or 2 * len(self.running) + 2))
        size = max(1, min(size, MAX_PACK_SIZE, share), math.ceil(self._total / MAX_TRIALS))
        kind = cell.agent, cell.task
        alike = itertools.takewhile(lambda c: (c.agent, c.task) == kind, reversed(self.cells[-size:]))
        return len(list(alike))
