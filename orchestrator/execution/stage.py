"""Runs the missing cells of a stage: builds the queue, ships the sources, persists the outcomes."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from rich.console import Console

from orchestrator.errors import InterruptedSweepError, SweepError
from orchestrator.execution.display import Display
from orchestrator.execution.executors.early_stopping import EarlyStopping
from orchestrator.execution.executors.executor import Executor, Workplace, executor
from orchestrator.execution.executors.monitor import OutcomeSink, StageMonitor
from orchestrator.execution.ledger import Ledger
from orchestrator.execution.settings import OnRecord, RunSummary, Settings
from orchestrator.execution.work_queue import CellStatus, Pack, WorkQueue
from orchestrator.planning.arms import Arm
from orchestrator.results.driver_log import logging_to
from orchestrator.results.sweep_folder import Results
from trainables.agents.registry import agent_named
from trainables.cell import Cell
from trainables.plugins import loader
from trainables.training.cell_run import lost
from trainables.training.train import source_knowledge
from trainables.training.worker import WorkerPayload

if TYPE_CHECKING:
    from orchestrator.planning.search import Tuned

Arrays = dict[str, Any]


@dataclass(frozen=True)
class Work:
    """The cells of a stage to run."""

    stage: str
    arms: Sequence[Arm]
    missing: list[Cell]
    keep: bool
    """Whether each cell's knowledge is to be kept."""
    whole: bool = False
    """Whether every cell is trained to its end, whatever scheduler there is."""


class Stages:
    """Runs stages on one executor, which is opened for the first missing cell."""

    def __init__(
        self,
        results: Results,
        settings: Settings,
        ledger: Ledger,
        summary: RunSummary,
        console: Console,
        on_record: OnRecord,
        stack: ExitStack,
    ) -> None:
        self._results, self._space, self._settings = results, results.space(), settings
        self._ledger, self._summary, self._console = ledger, summary, console
        self._on_record, self._stack = on_record, stack
        stack.enter_context(logging_to(results.folder))
        self._opened: tuple[Executor, Workplace] | None = None

    def run(self, work: Work) -> None:
        """Run the missing cells. Raises InterruptedSweepError where an interruption leaves some."""
        ledger = self._ledger
        tuned = [arm for arm in work.arms if arm.ranges]
        searches = [self._search(arm) for arm in tuned]
        total = len(work.missing) + sum(search.left * search.arm.width for search in searches)
        if not total:
            return
        sources = self._sources([*work.missing, *(cell for arm in tuned for cell in arm.cells(arm.first()))])
        runner, workplace = self._open()
        payload = WorkerPayload(
            sources,
            work.keep,
            str(workplace.checkpoints) if workplace.checkpoints else None,
            self._settings.checkpoint_seconds,
            loader.packed(),
        )
        with Display(self._console, work.stage, total, self._results.folder) as display:
            sink = OutcomeSink(work.stage, ledger, self._summary, display, self._on_record)
            monitor = StageMonitor(self._queue(work, searches, workplace), sink, display, self._stopping(work))
            try:
                runner.run_stage(monitor, payload)
            except Exception as error:
                if sink.failure is None:
                    raise
                raise SweepError(f"cannot write a record ({sink.failure}); all earlier ones are kept") from error
        ledger.plan(work.stage, ledger.planned(work.stage))
        if any(not ledger.ended(cell, work.keep) for cell in ledger.planned(work.stage)):
            raise InterruptedSweepError

    def _search(self, arm: Arm) -> Tuned:
        from orchestrator.planning.search import Tuned

        return Tuned(arm, self._space.search, self._ledger.searched(arm), self._ledger.score)

    def lose(self, stage: str, cells: Iterable[tuple[Cell, str]]) -> None:
        """Record cells that cannot run as failed, each with its reason."""
        outcomes = [lost(cell, why, 0.0) for cell, why in cells]
        for record in self._ledger.take(stage, outcomes) if outcomes else ():
            self._summary.ended(record)
            self._on_record(stage, record)

    def _open(self) -> tuple[Executor, Workplace]:
        """Return the executor and its workplace, opened once."""
        if self._opened is None:
            made = executor(self._settings)
            self._opened = made, made.open(self._ledger.checkpoints, self._console, self._stack)
            self._summary.workers = self._opened[1].workers
        return self._opened

    def _queue(self, work: Work, searches: Sequence[Tuned], workplace: Workplace) -> WorkQueue:
        """Return the queue of missing cells, long ones first; with a scheduler each configuration is one pack."""
        together = self._space.search.scheduler is not None and not work.whole
        packs: list[Pack] = []
        alone = work.missing
        if together:
            left = {cell.id: cell for cell in work.missing}
            rivals = [arm for arm in work.arms if len(arm.grid) > 1 and not arm.ranges]
            for configuration in (arm.cells(values) for arm in rivals for values in arm.grid):
                cells = [left.pop(cell.id) for cell in configuration if cell.id in left]
                packs += [Pack(tuple(cells), together=True)] if cells else []
            alone = list(left.values())
        tabular = [cell for cell in alone if agent_named(cell.agent).kind == "tabular"]
        deep = [cell for cell in alone if agent_named(cell.agent).kind != "tabular"]
        tabular.sort(key=lambda cell: (cell.task, cell.agent))
        return WorkQueue(
            CellStatus(lambda cell: self._ledger.ended(cell, work.keep), self._ledger.score),
            at_once=workplace.at_once,
            cells=[*reversed(tabular), *reversed(deep)],
            packs=packs[::-1],
            tuned=searches,
            together=together,
            time_limit=self._settings.time_limit,
        )

    def _stopping(self, work: Work) -> EarlyStopping | None:
        settings = None if work.whole else self._space.search.scheduler
        return EarlyStopping(settings, work.arms, self._ledger.scores) if settings else None

    def _sources(self, cells: Iterable[Cell]) -> dict[str, Arrays]:
        """Return the arrays of every source that `cells` use, by `Source.key`."""
        sources: dict[str, Arrays] = {}
        for cell in cells:
            if cell.sources and cell.source_key not in sources:
                sources[cell.source_key] = dict(source_knowledge(cell, self._ledger.library.load).arrays)
        return sources
