"""Running what a stage lacks: its queue, its shipment to the workers, and the taking over of what they tell."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rich.console import Console

from orchestrator.errors import InterruptedSweepError, SweepError
from orchestrator.execution.display import Display
from orchestrator.execution.ledger import Ledger
from orchestrator.execution.settings import Settings, Tally
from orchestrator.planning.arms import Arm
from orchestrator.results.record import Record
from orchestrator.results.sweep_folder import Results
from trainables.agents.registry import agent_named
from trainables.cell import Cell
from trainables.storage.folders import make_folder
from trainables.training.cell_run import Outcome, lost
from trainables.training.train import source_knowledge

if TYPE_CHECKING:
    from orchestrator.execution.early_stopping import ArmSchedulers
    from orchestrator.execution.work_queue import WorkQueue
    from orchestrator.planning.search import Tuned

Arrays = dict[str, Any]
OnRecord = Callable[[str, Record], None]
"""Is told the stage and the record of each cell as it ends."""


@dataclass(frozen=True)
class Work:
    """What a stage has to run."""

    stage: str
    arms: Sequence[Arm]
    missing: list[Cell]
    keep: bool
    """Whether what each cell has learned is wanted."""


class Stages:
    """Runs stages over one connection to Ray, which is made when the first cell is missing."""

    def __init__(
        self,
        results: Results,
        settings: Settings,
        ledger: Ledger,
        tally: Tally,
        console: Console,
        on_record: OnRecord,
        stack: ExitStack,
    ) -> None:
        self._results, self._space, self._settings = results, results.space(), settings
        self._ledger, self._tally, self._console = ledger, tally, console
        self._on_record, self._stack = on_record, stack
        self._checkpoints: Path | None = None

    def run(self, work: Work) -> None:
        """Run what is missing; InterruptedSweepError where something is left."""
        from orchestrator.planning.search import Tuned

        ledger = self._ledger
        tuned = [arm for arm in work.arms if arm.ranges]
        searches = [Tuned(arm, self._space.search, ledger.searched(arm), ledger.score) for arm in tuned]
        total = len(work.missing) + sum(search.left * len(search.arm.seeds) for search in searches)
        if not total:
            return
        sources = self._sources([*work.missing, *(cell for arm in tuned for cell in arm.cells(arm.first()))])
        self._connect()
        with Display(self._console, work.stage, total, self._results.folder) as display:
            taking = _Taking(work.stage, ledger, self._tally, display, self._on_record)
            queue = self._queue(work, searches, taking)
            try:
                self._run_queue(queue, work, sources, taking, display)
            except Exception as error:
                if taking.failure is None:
                    raise
                raise SweepError(f"cannot write a record ({taking.failure}); all earlier ones are kept") from error
        ledger.plan(work.stage, ledger.planned(work.stage))
        if any(not ledger.ended(cell, work.keep) for cell in ledger.planned(work.stage)):
            raise InterruptedSweepError

    def lose(self, stage: str, cells: Iterable[tuple[Cell, str]]) -> None:
        """Write down cells that cannot run, each with the reason, as failed."""
        outcomes = [lost(cell, why, 0.0) for cell, why in cells]
        for record in self._ledger.take(stage, outcomes) if outcomes else ():
            self._tally.ended(record)
            self._on_record(stage, record)

    def _run_queue(
        self, queue: WorkQueue, work: Work, sources: dict[str, Arrays], taking: _Taking, display: Display
    ) -> None:
        from orchestrator.cluster import connection
        from orchestrator.execution import tune_runner

        shipment = tune_runner.Shipment(sources, work.keep, self._checkpoints, self._settings.checkpoint_seconds)
        with connection.watched_head(display.abandon):
            tune_runner.run_stage(
                queue, shipment, self._settings.resources, taking, display, self._schedulers(queue, work.arms)
            )

    def _connect(self) -> None:
        """Ray, once; how many cells it takes at a time; and where checkpoints can be."""
        if self._tally.workers:
            return
        from orchestrator.cluster import connection, nodes

        settings, folder = self._settings, self._ledger.checkpoints
        with self._console.status("starting Ray"):
            resources = settings.resources
            self._stack.enter_context(connection.connected(settings.workers, settings.address, resources))
            fits = nodes.capacity(resources, nodes.NODE_PATIENCE if settings.address else 0.0)
            self._tally.workers = min(settings.workers or fits, fits)
            self._checkpoints = make_folder(folder)
            if blind := nodes.blind_nodes(folder):
                self._checkpoints = None
                self._console.print(f"no checkpoints: {', '.join(blind)} cannot see {folder}", style="yellow")

    def _queue(self, work: Work, searches: Sequence[Tuned], taking: _Taking) -> WorkQueue:
        """The missing cells, long ones first; where a scheduler stops configurations, each of those is one pack."""
        from orchestrator.execution.work_queue import Ledgered, Pack, WorkQueue

        together = self._space.search.scheduler is not None
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
            Ledgered(lambda cell: self._ledger.ended(cell, work.keep), self._ledger.score, taking.failed),
            at_once=self._settings.workers or (None if self._settings.address else self._tally.workers),
            cells=[*reversed(tabular), *reversed(deep)],
            packs=packs[::-1],
            tuned=searches,
            together=together,
            time_limit=self._settings.time_limit,
        )

    def _schedulers(self, queue: WorkQueue, arms: Sequence[Arm]) -> ArmSchedulers | None:
        settings = self._space.search.scheduler
        if settings is None:
            return None
        from orchestrator.execution.early_stopping import ArmSchedulers

        def together(trial: str) -> Sequence[Cell]:
            pack = queue.running[trial].pack
            return pack.cells if pack.together else ()

        return ArmSchedulers(settings, together, arms, self._ledger.scores)

    def _sources(self, cells: Iterable[Cell]) -> dict[str, Arrays]:
        """The arrays of every source that `cells` use, by `Source.key`."""
        sources: dict[str, Arrays] = {}
        for cell in cells:
            if cell.sources and cell.source_key not in sources:
                sources[cell.source_key] = dict(source_knowledge(cell, self._ledger.library.load).arrays)
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

    def __call__(self, outcomes: list[Outcome]) -> None:
        """Take over what became of some cells. An OSError ends the sweep: a result that cannot be kept is none."""
        try:
            records = self.ledger.take(self.stage, outcomes)
        except OSError as error:
            self.failure = error
            raise
        for record in records:
            self.tally.ended(record)
            self.display.ended(record)
            self.on_record(self.stage, record)

    def failed(self, cell: Cell, error: str, seconds: float) -> None:
        """Take over a cell that was lost with its worker for good."""
        self([lost(cell, error, seconds)])
