"""Runs the missing cells of a stage: builds the queue, ships the sources, persists the outcomes."""

from __future__ import annotations

import itertools
import logging
from collections.abc import Generator, Iterable, Iterator, Mapping, Sequence
from contextlib import ExitStack, closing
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from rich.console import Console

from orchestrator.errors import InterruptedSweepError, SweepError
from orchestrator.execution.cells.ledger import Ledger
from orchestrator.execution.cells.longer import LEAST_SECONDS, LEAST_SECONDS_REMOTE, Places
from orchestrator.execution.display import Display
from orchestrator.execution.executors.early_stopping import EarlyStopping
from orchestrator.execution.executors.executor import Executor, StageRun, Workplace, executor
from orchestrator.execution.executors.monitor import OutcomeSink, StageMonitor
from orchestrator.execution.settings import OnRecord, RunSummary, Settings, origins
from orchestrator.execution.work_queue import CellStatus, Pack, WorkQueue
from orchestrator.planning.arms import Arm
from orchestrator.results.driver_log import logging_to
from orchestrator.results.sweep_folder import Results
from trainables.agents.registry import agent_named
from trainables.cell import Cell
from trainables.plugins import loader
from trainables.storage.paths import is_local
from trainables.training.end_states import EndStates
from trainables.training.messages import WorkerPayload, lost
from trainables.training.source_knowledge import source_knowledge

if TYPE_CHECKING:
    from orchestrator.planning.search import Tuned

Arrays = dict[str, Any]

log = logging.getLogger("deltatune.sweep")


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
    followed: bool = False
    """Whether another stage may follow."""
    further: int = 0
    """Cells of the stage that may follow, if a sequential test over seeds goes on."""

    @property
    def searches(self) -> bool:
        """Whether an arm searches ranges."""
        return any(arm.ranges for arm in self.arms)


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
        self._sink: OutcomeSink | None = None
        self._workers: set[tuple[int, str]] = set()
        self._said: set[str] = set()

    def run(self, works: Iterator[Work]) -> None:
        """Run the missing cells of each stage. Raises InterruptedSweepError where an interruption leaves some.

        works: what each stage has to run; the next one is asked for when the one before has ended.
        """
        with closing(self._runs(works)) as runs:
            if (first := next(runs, None)) is None:
                return
            try:
                self._open()[0].run(itertools.chain([first], runs))
            except Exception as error:
                if self._sink is None or self._sink.failure is None:
                    raise
                raise SweepError(f"cannot write a record ({self._sink.failure}); all earlier ones are kept") from error

    def _runs(self, works: Iterator[Work]) -> Generator[StageRun, None, None]:
        """Begin each stage that has something to run, and end it when the next one is asked for."""
        ledger = self._ledger
        for work in works:
            searches = [self._search(arm) for arm in work.arms if arm.ranges]
            total = len(work.missing) + sum(search.left * search.arm.width for search in searches)
            if not total:
                continue
            workplace = self._open()[1]
            known = self._longer(work) if workplace.checkpoints else {}
            payload = self._payload(work, workplace, self._end_states(total, work, known))
            with Display(self._console, work.stage, total, self._results.folder, work.further, self._said) as display:
                self._sink = OutcomeSink(work.stage, ledger, self._summary, display, self._on_record)
                queue, stopping = self._queue(work, searches, workplace), self._stopping(work)
                monitor = StageMonitor(queue, self._sink, display, stopping, self._workers)
                yield StageRun(monitor, payload, work.followed)
            ledger.plan(work.stage, ledger.planned(work.stage))
            if any(not ledger.ended(cell, work.keep) for cell in ledger.planned(work.stage)):
                raise InterruptedSweepError
            ledger.drop_outgrown(work.stage, known)

    def _longer(self, work: Work) -> Places:
        """Say what cells that are longer than ended ones save, and return the end states that they may continue."""
        shorter = self._ledger.shorter()
        found = shorter.of(work.missing)
        for sentence in found.longer.sentences():
            self._console.print(f"{work.stage}: {sentence}", soft_wrap=True)
            log.info("%s: %s", work.stage, sentence)
        searched = {(arm.agent, arm.task) for arm in work.arms if arm.ranges}
        return {**(shorter.of_kinds(searched) if searched else {}), **found.known}

    def _end_states(self, total: int, work: Work, known: Places) -> EndStates:
        """Return where end states are kept: all cells of the stage share what they may take."""
        cells = total - len(work.missing) + len(self._ledger.planned(work.stage))
        least = LEAST_SECONDS if is_local(self._ledger.states) else LEAST_SECONDS_REMOTE
        most = int(self._settings.keep_states * 1e9 / cells)
        return EndStates(str(self._ledger.states), most, least, known)

    def _payload(self, work: Work, workplace: Workplace, ends: EndStates) -> WorkerPayload:
        """Return what every worker of a stage needs."""
        first = [cell for arm in work.arms if arm.ranges for cell in arm.cells(arm.first())]
        return WorkerPayload(
            self._sources([*work.missing, *first]),
            work.keep,
            str(workplace.checkpoints) if workplace.checkpoints else None,
            self._settings.checkpoint_seconds,
            loader.packed(),
            ends if workplace.checkpoints else None,
        )

    def _search(self, arm: Arm) -> Tuned:
        from orchestrator.planning.search import Tuned

        return Tuned(arm, self._space.search, self._ledger.searched(arm), self._ledger.score)

    def lose(self, stage: str, cells: Iterable[tuple[Cell, str]]) -> None:
        """Record cells that cannot run as failed, each with its reason."""
        outcomes = [lost(cell, why, 0.0) for cell, why in cells]
        for record in self._ledger.take(stage, outcomes) if outcomes else ():
            self._summary.ended(record)
            self._on_record(stage, record)

    def took(self, stage: str, taken: Mapping[str, int]) -> None:
        """Count and say how many cells of a stage were copied, and from where."""
        self._summary.took(taken)
        if taken:
            self._console.print(f"{stage}: {origins(taken)}", soft_wrap=True)

    def spared(self, sources: int) -> None:
        """Say how many recorded sources do not train again, though the library has not what they learned."""
        if sources:
            what = f"source: no missing cell needs what {sources} recorded sources learned, which is not in the library"
            self._console.print(f"{what}: --reuse none trains them again", soft_wrap=True)

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
            CellStatus(lambda cell: self._ended(work, cell), self._ledger.score),
            at_once=workplace.at_once,
            cells=[*reversed(tabular), *reversed(deep)],
            packs=packs[::-1],
            tuned=searches,
            together=together,
            time_limit=self._settings.time_limit,
        )

    def _ended(self, work: Work, cell: Cell) -> bool:
        """Return whether a cell has ended; one that a search suggests may have ended elsewhere."""
        if work.searches:
            self._summary.took(self._ledger.take_over(work.stage, [cell], work.keep))
        return self._ledger.ended(cell, work.keep)

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
