"""The queue of a stage: packs cells into trials, and decides what happens after a lost or overdue worker.

It reads the state of cells and returns the cells that must fail; it never writes.
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
from trainables.training.messages import Outcome

if TYPE_CHECKING:
    from orchestrator.planning.search import Tuned

TARGET_SECONDS = 4.0
"""Least length of a trial, since starting and ending one costs the driver about 0.05 s."""

MAX_PACK_SIZE = 128
"""Cells of one trial."""

MAX_TRIALS = 20_000
"""Trials of a stage: Tune keeps some 20 KB for each of them until the stage ends."""

FIRST_GUESS = 4
"""Tabular cells of one trial before any of their kind has been timed."""

MAX_WORKER_LOSSES = 3
"""Worker losses without progress after which a cell fails."""

MIN_PROGRESS = 0.01
"""Share of a cell that counts as progress."""


@dataclass(frozen=True)
class Pack:
    """The cells of one trial."""

    cells: tuple[Cell, ...]
    together: bool = False
    """Whether they are trained side by side under a scheduler."""


@dataclass
class Running:
    """A pack on a worker."""

    pack: Pack
    pid: int | None = None
    node: str | None = None
    since: float | None = None
    """When its current cell began, by the driver's clock; None: its worker is starting."""
    killed: bool = False


@dataclass(frozen=True)
class CellStatus:
    """Callbacks through which the queue asks for the state of cells."""

    ended: Callable[[Cell], bool]
    score: Callable[[Sequence[Cell]], float | None]


@dataclass(frozen=True)
class LostOutcome:
    """A cell that must fail, since its worker is gone and cannot report it."""

    cell: Cell
    error: str
    seconds: float


@dataclass
class WorkQueue:
    """The remaining work of a stage. A worker has one pack at a time."""

    status: CellStatus
    at_once: int | None
    """Packs at a time; None: as many as the cluster takes."""
    cells: list[Cell] = field(default_factory=list)
    """Cells without a scheduler, the next one last."""
    packs: list[Pack] = field(default_factory=list)
    tuned: Sequence[Tuned] = ()
    together: bool = False
    """Whether suggested configurations run under a scheduler."""
    time_limit: float | None = None
    """Seconds that a cell may take."""
    running: dict[str, Running] = field(default_factory=dict)
    stopping: bool = False
    """Whether to hand out nothing more."""
    _unsettled: dict[tuple[int, str], tuple[Tuned, str]] = field(default_factory=dict)
    """Suggestions whose cells were on a worker, until all of them have ended."""
    _furthest: dict[str, float] = field(default_factory=dict)
    _losses: dict[str, int] = field(default_factory=lambda: defaultdict(int))
    _seconds: dict[tuple[str, str], tuple[int, float]] = field(default_factory=lambda: defaultdict(lambda: (0, 0.0)))

    def __post_init__(self) -> None:
        self._total = len(self.cells)

    def next(self, trial: str) -> Pack | None:
        """Return the pack of a new trial, or None if there is none at the moment (see `over`)."""
        if self.stopping or (self.at_once is not None and len(self.running) >= self.at_once):
            return None
        pack = self._next()
        if pack is not None:
            self.running[trial] = Running(pack)
        return pack

    def over(self) -> bool:
        """Return whether no more packs will come."""
        return not self.running and (self.stopping or self.drained())

    def drained(self) -> bool:
        """Return whether all packs are handed out; one whose worker is lost may come back."""
        return not self.cells and not self.packs and not any(tuned.left for tuned in self.tuned)

    def on_started(self, trial: str, pid: int, node: str) -> None:
        """Note that a pack's worker has started its first cell; ignored if the pack was given up before the report."""
        if (running := self.running.get(trial)) is None:
            return
        running.pid, running.node, running.since = pid, node, clock.monotonic()

    def on_outcomes(self, trial: str, outcomes: Iterable[Outcome]) -> None:
        """Note that cells of a pack have ended, and the next one begins."""
        if trial in self.running:
            self.running[trial].since = clock.monotonic()
        for outcome in outcomes:
            kind = outcome.cell.agent, outcome.cell.task
            count, total = self._seconds[kind]
            self._seconds[kind] = count + 1, total + outcome.seconds

    def on_progress(self, cell: str, share: float) -> None:
        """Note the progress of a long cell; if it is farther than ever, its earlier losses count no more."""
        if share > self._furthest.get(cell, 0.0) + MIN_PROGRESS:
            self._furthest[cell] = share
            self._losses.pop(cell, None)

    def overdue(self) -> list[Running]:
        """Return the packs whose current cell is over its time limit, each once."""
        if self.time_limit is None:
            return []
        now = clock.monotonic()
        late = [r for r in self.running.values() if r.since is not None and now - r.since > self.limit(r.pack)]
        late = [running for running in late if not running.killed]
        for running in late:
            running.killed = True
        return late

    def limit(self, pack: Pack) -> float:
        """Return the time limit of a pack's current cell; cells that share a worker under a scheduler add theirs up."""
        assert self.time_limit is not None
        return self.time_limit * (len(pack.cells) if pack.together else 1) + 1.0

    def on_lost(self, trial: str, why: str) -> list[LostOutcome]:
        """Return the cells that must fail after the loss of a worker, for the caller to persist.

        If several cells are left, each then runs alone, which isolates the one at fault.
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
        """Count a loss of the cell's worker; return its failure, or None where it may be tried again."""
        seconds = clock.monotonic() - (running.since or clock.monotonic())
        self._losses[cell.id] += 1
        if running.killed:
            return LostOutcome(cell, f"it took longer than its time limit of {self.time_limit:g} s", seconds)
        if self._losses[cell.id] >= MAX_WORKER_LOSSES:
            return LostOutcome(cell, f"its worker was lost {MAX_WORKER_LOSSES} times, at last: {why}", seconds)
        return None

    def on_completed(self, trial: str) -> None:
        """Note that a trial has ended, unless `on_lost` has handled it already."""
        self.running.pop(trial, None)

    def _settle(self) -> None:
        """Report to the searches the suggestions whose cells have all ended."""
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
        """Return the size of the next pack: it should fill TARGET_SECONDS, but leave cells for every worker."""
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
