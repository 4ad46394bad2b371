"""A sweep: stage 1 trains the sources, stage 2 the transfers; what is done already is never run again."""

from __future__ import annotations

import json
import os
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import filelock
from rich.console import Console

from orchestrator.aggregates import groups
from orchestrator.errors import InterruptedSweepError, SweepError
from orchestrator.ledger import Ledger
from orchestrator.plan import Pair, Params, SourceChoice, source_pairs, transfer_pairs
from orchestrator.progress import Display
from orchestrator.record import Record
from orchestrator.results import Results
from orchestrator.selection import select
from orchestrator.status import DRIVER, LOCK, owner
from trainables.cell import Cell
from trainables.errors import InputError
from trainables.training import exact_source

SOURCE, TRANSFER = "source", "transfer"
"""The stages."""

Arrays = dict[str, Any]
OnRecord = Callable[[str, Record], None]
"""Is told the stage and the record of each cell as it ends."""


@dataclass(frozen=True)
class Settings:
    """How a sweep runs; nothing here decides a result but `params`, which settles hyperparameters."""

    workers: int | None = None
    """Cells at a time; None: one per CPU."""
    address: str | None = None
    """A running Ray cluster; None: this machine."""
    retry_failed: bool = False
    checkpoint_seconds: float = 5.0
    """Time between the checkpoints of a long cell."""
    params: Params = field(default_factory=dict)


@dataclass
class Tally:
    """What a run of a sweep did."""

    ran: int = 0
    failed: int = 0
    reused: int = 0
    """Cells that had ended before."""
    training_seconds: float = 0.0
    """Summed over the cells that ran."""
    seconds: float = 0.0
    workers: int = 0
    lost: list[str] = field(default_factory=list)
    """Errors of trials whose worker was lost more often than it is started again."""


def run(
    results: Results, settings: Settings, console: Console, on_record: OnRecord = lambda stage, record: None
) -> Tally:
    """Run what is missing of a sweep, telling `on_record` of each cell as it ends.

    Raises InputError for a damaged record or a sweep that another driver is at; SweepError where no configuration
    of a source is complete or a record cannot be written; InterruptedSweepError after Ctrl-C.
    """
    started = time.monotonic()
    with _locked(results.folder), ExitStack() as stack:
        stages = _Stages(results, settings, console, on_record, stack)
        stages.transfer(stages.train_sources())
    stages.tally.seconds = time.monotonic() - started
    return stages.tally


class _Stages:
    """The two stages of one run, and the connection to Ray, which is made when the first cell is missing."""

    def __init__(
        self,
        results: Results,
        settings: Settings,
        console: Console,
        on_record: OnRecord,
        stack: ExitStack,
    ) -> None:
        self._space = results.space()
        self._settings, self._console, self._on_record, self._stack = settings, console, on_record, stack
        self._ledger = Ledger(results, settings.retry_failed)
        self.tally = Tally()

    def train_sources(self) -> list[SourceChoice]:
        """Stage 1: the outcome of each scenario's source."""
        pairs = source_pairs(self._space, self._settings.params)
        keep = any("learned" in scenario.source.kinds for scenario in self._space.scenarios)
        self._run(SOURCE, [pair for pair in pairs if pair is not None], keep)
        return [SourceChoice({}, {}) if pair is None else self._choose(pair) for pair in pairs]

    def transfer(self, choices: Sequence[SourceChoice]) -> None:
        """Stage 2."""
        self._run(TRANSFER, transfer_pairs(self._space, choices, self._settings.params), keep=False)

    def _choose(self, pair: Pair) -> SourceChoice:
        cells = [cell for cell in self._ledger.planned(SOURCE) if pair.owns(cell)]
        table = self._ledger.table(cells, SOURCE)
        selected = select(groups(table), table).get(pair.key)
        if selected is None:
            errors = table["error"].dropna()
            why = f"; the first error: {errors.iloc[0]}" if len(errors) else ""
            raise SweepError(f"no configuration of {pair.agent} on the source task {pair.task} has all its seeds{why}")
        swept = {*pair.ranges, *(name for values in pair.grid for name in values)}
        best = {name: value for name, value in selected.best.hyperparameters.items() if name in swept}
        chosen = [cell for cell in cells if cell.group == selected.best.id]
        return SourceChoice(best, {cell.seed: self._ledger.source_run(cell) for cell in chosen})

    def _run(self, stage: str, pairs: Sequence[Pair], keep: bool) -> None:
        """Plan a stage and run what it lacks."""
        ledger, search = self._ledger, self._space.search
        pairs = [_drawn(pair, self._space) if pair.ranges and search.method == "random" else pair for pair in pairs]
        tuned = [pair for pair in pairs if pair.ranges]
        searched = [cell for pair in tuned for cell in ledger.searched(pair)]
        cells = ledger.plan(stage, [*(cell for pair in pairs for cell in pair.all_cells()), *searched])
        missing = [cell for cell in cells if not ledger.ended(cell, keep)]
        self.tally.reused += sum(ledger.ended(cell, keep) and not ledger.new(cell) for cell in cells)
        if missing or tuned:
            self._run_missing(stage, missing, tuned, keep)

    def _run_missing(self, stage: str, missing: list[Cell], tuned: Sequence[Pair], keep: bool) -> None:
        from orchestrator import runner
        from orchestrator.search import Tuned

        ledger = self._ledger
        searches = [Tuned(pair, self._space.search, ledger.searched(pair), ledger.score) for pair in tuned]
        total = len(missing) + sum(search.left * len(search.pair.seeds) for search in searches)
        if not total:
            return
        sources = self._sources([*missing, *(cell for pair in tuned for cell in pair.cells(pair.grid[0]))])
        if not self.tally.workers:
            with self._console.status("starting Ray"):
                connection = runner.connected(self._settings.workers, self._settings.address)
                self.tally.workers = self._stack.enter_context(connection)
        with Display(self._console, stage, total) as display:
            taking = _Taking(stage, ledger, self.tally, display, self._on_record)
            every = self._settings.checkpoint_seconds
            work = runner.Work(missing, searches, sources, keep, self._ledger.checkpoints, every)
            try:
                self.tally.lost += runner.run_stage(work, self.tally.workers, taking, display, ledger)
            except Exception as error:
                if taking.failure is None:
                    raise
                raise SweepError(f"cannot write a record ({taking.failure}); all earlier ones are kept") from error
        ledger.plan(stage, ledger.planned(stage))
        left = sum(not ledger.ended(cell, keep) for cell in ledger.planned(stage))
        if left and not self.tally.lost:
            left_over = f"stopped with {left} cells of the {stage} stage left"
            raise InterruptedSweepError(f"{left_over}; the same command goes on from here")

    def _sources(self, cells: Iterable[Cell]) -> dict[str, Arrays]:
        """The arrays of every source that `cells` use, by `Source.key`."""
        sources: dict[str, Arrays] = {}
        for cell in cells:
            if cell.source is not None and cell.source_key not in sources:
                if cell.source.kind == "exact":
                    knowledge = exact_source(cell.source.task, cell.settings.gamma)
                else:
                    knowledge = self._ledger.library.load(str(cell.source.cell_id))
                sources[cell.source_key] = dict(knowledge.arrays)
        return sources


@dataclass
class _Taking:
    """Takes over each outcome from Tune's loop: to disk, into the tally, onto the display, to the tracker."""

    stage: str
    ledger: Ledger
    tally: Tally
    display: Display
    on_record: OnRecord
    failure: OSError | None = None

    def __call__(self, outcome: dict[str, Any]) -> None:
        """Take over the outcome of one cell. An OSError stops the sweep: a result that cannot be kept is no result."""
        try:
            record = self.ledger.take(self.stage, outcome)
        except OSError as error:
            self.failure = error
            raise
        if record is None:
            return
        self.tally.ran += 1
        self.tally.failed += record.status == "failed"
        self.tally.training_seconds += record.seconds
        self.display.ended(record)
        self.on_record(self.stage, record)


def _drawn(pair: Pair, space: Any) -> Pair:
    """The pair with its ranges replaced by random draws from them."""
    from orchestrator.search import draw

    return replace(pair, grid=tuple(draw(pair, space.search)), ranges={})


@contextmanager
def _locked(folder: Path) -> Iterator[None]:
    """Only one driver at a sweep; InputError that names the other one. A dead driver's lock is free."""
    lock, who = filelock.FileLock(folder / LOCK), folder / DRIVER
    try:
        lock.acquire(timeout=0)
    except filelock.Timeout:
        raise InputError(f"the sweep in {folder} is being run by {owner(folder)}: wait for it, or stop it") from None
    try:
        who.write_text(json.dumps({"pid": os.getpid(), "host": os.uname().nodename, "since": time.time()}))
        yield
    finally:
        who.unlink(missing_ok=True)
        lock.release()
