"""Runs a sweep: stage 1 trains the sources, stage 2 the transfers; finished cells never run again."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator, Sequence
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from rich.console import Console

from orchestrator import clock
from orchestrator.cluster import ending
from orchestrator.errors import InterruptedSweepError, LeaseLostError, SweepError
from orchestrator.execution.cells.ledger import Ledger
from orchestrator.execution.cells.sequential import needed, needed_at_most, test
from orchestrator.execution.settings import OnRecord, RunSummary, Settings
from orchestrator.execution.sources.needed_networks import spare
from orchestrator.execution.sources.source_choice import choose
from orchestrator.execution.sources.source_ranking import ranked
from orchestrator.execution.stage import Stages, Work
from orchestrator.planning.arms import CONFIRM, Arm, distinct
from orchestrator.planning.confirmation import (
    CONFIRM_SOURCE,
    CONFIRMATION,
    check_confirmation,
    confirm_arms,
    confirm_source_arms,
    expected_arms,
    with_unseen,
)
from orchestrator.planning.plan import SOURCE, TRANSFER, source_arms, transfer_arms
from orchestrator.planning.source_choice import PLACEHOLDER_STEPS, Choices, SourceChoice, settle, untrained
from orchestrator.results.lock import locked
from orchestrator.results.sweep_folder import Results
from search_spaces.search_space import SearchSpace
from trainables.cell import Cell
from trainables.training.source_knowledge import exact_source

if TYPE_CHECKING:
    from orchestrator.dataset.dataset import Dataset

STAGES = (SOURCE, TRANSFER, *CONFIRMATION)


def run(
    results: Results, settings: Settings, console: Console, on_record: OnRecord = lambda stage, record: None
) -> RunSummary:
    """Take a sweep's lock and run its missing cells; see `run_held`. Raises InputError where another driver runs it."""
    with locked(results.folder) as hold:
        results.guard(hold)
        try:
            return run_held(results, settings, console, on_record)
        finally:
            ending.wait()


def run_held(
    results: Results, settings: Settings, console: Console, on_record: OnRecord = lambda stage, record: None
) -> RunSummary:
    """Run the missing cells of a sweep whose lock is held, calling `on_record` for each cell as it ends.

    After Ctrl-C or SIGTERM the summary has the cells that remain in `left`. Raises InputError for a cell that fits on
    no node; SweepError where a record cannot be written, another driver took the sweep over or the cluster is gone.
    """
    started = clock.monotonic()
    with ExitStack() as stack:
        ledger, tally = Ledger(results, settings.retry_failed, reuse=settings.reuse), RunSummary()
        for damage in (*results.repaired, *ledger.damage):
            console.print(f"{damage}: the cells concerned run again", style="yellow", soft_wrap=True)
        sweep = _Sweep(
            results, settings, ledger, tally, Stages(results, settings, ledger, tally, console, on_record, stack)
        )
        try:
            tally.left = sweep.run()
            ledger.close()
        except LeaseLostError as error:
            raise SweepError(str(error)) from error
        except OSError as error:
            raise SweepError(f"cannot write to {results.folder} ({error}); all earlier records are kept") from error
    tally.seconds = clock.monotonic() - started
    return tally


def restore(dataset: Dataset, name: str, storage: Path) -> int:
    """Write a published sweep to `storage`, planned as far as its records reach; return how many of them were missing.

    Raises InputError as `Dataset.restore` and `Results.prepare` do, and where a driver runs the sweep.
    """
    results = Results.prepare(storage, name)
    with locked(results.folder) as hold:
        results.guard(hold)
        written = dataset.restore(name, results)
        _plan_recorded(results)
    return written


def _plan_recorded(results: Results) -> None:
    """Plan a sweep as far as its records reach, and run nothing: what reports on them needs, and a sweep would do."""
    settings, quiet = Settings(local=True), Console(quiet=True)
    with ExitStack() as stack:
        ledger, tally = Ledger(results, retry_failed=False), RunSummary()
        stages = Stages(results, settings, ledger, tally, quiet, lambda stage, record: None, stack)
        for work in _Sweep(results, settings, ledger, tally, stages).works():
            if work.missing:
                return


class _Sweep:
    """The stages of one run."""

    def __init__(self, results: Results, settings: Settings, ledger: Ledger, tally: RunSummary, stages: Stages) -> None:
        self._results, self._space, self._settings = results, results.space(), settings
        self._ledger, self._tally, self._stages = ledger, tally, stages
        self._reused: dict[str, set[str]] = defaultdict(set)

    def run(self) -> int:
        """Run all stages, and return how many cells an interruption has left."""
        check_confirmation(self._space, self._settings.pretrained)
        try:
            self._stages.run(self.works())
        except InterruptedSweepError:
            return self._left()
        return 0

    def _left(self) -> int:
        """Return how many cells an interruption has left, those included that no stage has planned yet."""
        ledger, space, settings = self._ledger, self._space, self._settings
        left = sum(not ledger.ended(cell) for stage in STAGES for cell in ledger.planned(stage))
        if ledger.planned(TRANSFER) and (ledger.planned(CONFIRM) or not space.confirm):
            return left
        choices = settle(source_arms(space, settings.params), settings.pretrained, _untrained)
        transfers = transfer_arms(space, choices, settings.params)
        if not ledger.planned(TRANSFER):
            group = space.sequential.group if space.sequential else None
            left += self._missing([replace(arm, seeds=arm.seeds[:group]) for arm in transfers])
        if space.confirm and not ledger.planned(CONFIRM):
            sources, confirms = expected_arms(space, choices, transfers, settings.params, settings.pretrained)
            left += self._missing([*(arm for by_task in sources for arm in by_task.values()), *confirms])
        return left

    def _missing(self, arms: Sequence[Arm]) -> int:
        """Return how many cells of arms have not ended."""
        cells = {cell.id: cell for arm in arms for cell in arm.all_cells()}.values()
        searched = sum(self._space.search.budget * arm.width for arm in arms if arm.ranges)
        return searched + sum(not self._ledger.ended(cell) for cell in cells)

    def works(self) -> Iterator[Work]:
        """Yield what each stage lacks: sources, then transfers, planned once the sources are trained.

        The transfers of a failed source fail with it; the others run.
        """
        arms, pretrained = source_arms(self._space, self._settings.params), self._settings.pretrained
        keep = any("learned" in scenario.source.kinds for scenario in self._space.scenarios)
        every = (arm for scenario in arms for arm in scenario.values())
        self._stages.spared(spare(self._space, self._settings, self._ledger))
        yield self._work(SOURCE, distinct(arm for arm in every if arm.task not in pretrained), keep)
        chosen = settle(arms, pretrained, lambda arm: choose(self._ledger, arm, self._ledger.planned(SOURCE)))
        choices = ranked(self._space, chosen, self._results)
        transfers = transfer_arms(self._space, choices, self._settings.params)
        yield from self._by_groups(transfers) if self._space.sequential else [self._work(TRANSFER, transfers)]
        yield from self._confirmation(choices)

    def _by_groups(self, arms: Sequence[Arm]) -> Iterator[Work]:
        """Yield the transfers group of seeds after group, until every comparison is decided or the budget is spent.

        A run that continues another plans again from the first group on, and so comes to the same cells.
        """
        cells = needed(self._space, arms, {})
        further = len(needed_at_most(self._space, arms, None)) - len(cells)
        while True:
            yield replace(self._work(TRANSFER, arms, only=cells), followed=True, further=further)
            tested, before = test(self._space, self._results), cells
            cells, further = needed(self._space, arms, tested.looks), tested.further
            if len(cells) == len(before):
                return

    def _confirmation(self, choices: Sequence[Choices]) -> Iterator[Work]:
        """Yield what runs the selected configurations on unseen seeds, where the search space asks for it."""
        space, settings, ledger = self._space, self._settings, self._ledger
        if space.confirm is None:
            ledger.forget(CONFIRMATION)
            return
        from orchestrator.analysis.confirmation import chosen

        sources = confirm_source_arms(space, choices, settings.pretrained)
        yield self._work(CONFIRM_SOURCE, distinct(arm for by_task in sources for arm in by_task.values()), keep=True)
        unseen = with_unseen(choices, sources, ledger.source_runs)
        yield self._work(CONFIRM, confirm_arms(space, unseen, settings.params, chosen(self._results.rows())))

    def _work(self, stage: str, arms: Sequence[Arm], keep: bool = False, only: Sequence[Cell] | None = None) -> Work:
        """Plan a stage, and return what it lacks. only: of its cells these; None: all."""
        ledger, search = self._ledger, self._space.search
        arms = [_drawn(arm, self._space) if arm.ranges and search.method == "random" else arm for arm in arms]
        asked = None if only is None else {cell.id for cell in only}
        lost = {cell.id: (cell, arm.lost) for arm in arms if arm.lost for cell in arm.some_cells()}
        sound = [arm for arm in arms if not arm.lost]
        tuned = [arm for arm in sound if arm.ranges]
        searched = [cell for arm in tuned for cell in ledger.searched(arm)]
        grids = [cell for arm in sound for cell in arm.all_cells()]
        if asked is not None:
            grids = [cell for cell in grids if cell.id in asked]
            lost = {key: value for key, value in lost.items() if key in asked}
        self._stages.took(stage, ledger.take_over(stage, grids, keep))
        cells = ledger.plan(stage, [*grids, *searched, *(cell for cell, _ in lost.values())], arms)
        reused = {cell.id for cell in cells if ledger.ended(cell, keep) and not ledger.new(cell)}
        self._tally.reused += len(reused - self._reused[stage])
        self._reused[stage] |= reused
        lost = {key: lost[key] for key in lost.keys() - {cell.id for cell in (*grids, *searched)}}
        self._stages.lose(stage, [(cell, why) for cell, why in lost.values() if not ledger.ended(cell)])
        missing = [cell for cell in cells if not ledger.ended(cell, keep)]
        last = stage == (CONFIRM if self._space.confirm else TRANSFER)
        return Work(stage, sound, missing, keep, whole=stage in CONFIRMATION, followed=not last)


def foresee(space: SearchSpace, settings: Settings) -> None:
    """Compute the exact sources that the transfers will ask for; each is computed once in a process."""
    choices = settle(source_arms(space, settings.params), settings.pretrained, _untrained)
    cells = [cell for arm in transfer_arms(space, choices, settings.params) for cell in arm.some_cells()]
    exact = {
        (source.task, float(cell.hyperparameters["gamma"]))
        for cell in cells
        for source in cell.sources
        if source.kind == "exact"
    }
    for task, gamma in exact:
        exact_source(task, gamma)


def _untrained(arm: Arm) -> SourceChoice:
    return untrained(arm, PLACEHOLDER_STEPS)


def _drawn(arm: Arm, space: SearchSpace) -> Arm:
    """Return the arm with its ranges replaced by random draws from them."""
    from orchestrator.planning.search import draw

    return replace(arm, grid=tuple(draw(arm, space.search)), ranges={})
