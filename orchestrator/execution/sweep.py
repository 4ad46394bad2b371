"""Runs a sweep: stage 1 trains the sources, stage 2 the transfers; finished cells never run again."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import replace

from rich.console import Console

from orchestrator import clock
from orchestrator.errors import InterruptedSweepError, LeaseLostError, SweepError
from orchestrator.execution.ledger import Ledger
from orchestrator.execution.settings import OnRecord, RunSummary, Settings
from orchestrator.execution.source_choice import choose
from orchestrator.execution.source_ranking import ranked
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

STAGES = (SOURCE, TRANSFER, *CONFIRMATION)


def run(
    results: Results, settings: Settings, console: Console, on_record: OnRecord = lambda stage, record: None
) -> RunSummary:
    """Take a sweep's lock and run its missing cells; see `run_held`. Raises InputError where another driver runs it."""
    with locked(results.folder) as hold:
        results.log.guard(hold)
        return run_held(results, settings, console, on_record)


def run_held(
    results: Results, settings: Settings, console: Console, on_record: OnRecord = lambda stage, record: None
) -> RunSummary:
    """Run the missing cells of a sweep whose lock is held, calling `on_record` for each cell as it ends.

    After Ctrl-C or SIGTERM the summary has the cells that remain in `left`. Raises InputError for a cell that fits on
    no node; SweepError where a record cannot be written, another driver took the sweep over or the cluster is gone.
    """
    started = clock.monotonic()
    with ExitStack() as stack:
        ledger, tally = Ledger(results, settings.retry_failed), RunSummary()
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


class _Sweep:
    """The stages of one run."""

    def __init__(self, results: Results, settings: Settings, ledger: Ledger, tally: RunSummary, stages: Stages) -> None:
        self._results, self._space, self._settings = results, results.space(), settings
        self._ledger, self._tally, self._stages = ledger, tally, stages

    def run(self) -> int:
        """Run all stages, and return how many cells an interruption has left."""
        check_confirmation(self._space, self._settings.pretrained)
        try:
            choices = self.train_sources()
            self.transfer(choices)
            self.confirm(choices)
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
            left += self._missing(transfers)
        if space.confirm and not ledger.planned(CONFIRM):
            sources, confirms = expected_arms(space, choices, transfers, settings.params, settings.pretrained)
            left += self._missing([*(arm for by_task in sources for arm in by_task.values()), *confirms])
        return left

    def _missing(self, arms: Sequence[Arm]) -> int:
        """Return how many cells of arms have not ended."""
        cells = {cell.id: cell for arm in arms for cell in arm.all_cells()}.values()
        searched = sum(self._space.search.budget * arm.width for arm in arms if arm.ranges)
        return searched + sum(not self._ledger.ended(cell) for cell in cells)

    def train_sources(self) -> list[Choices]:
        """Run stage 1, and return the outcome for each scenario's sources."""
        arms, pretrained = source_arms(self._space, self._settings.params), self._settings.pretrained
        keep = any("learned" in scenario.source.kinds for scenario in self._space.scenarios)
        every = (arm for scenario in arms for arm in scenario.values())
        self._run(SOURCE, distinct(arm for arm in every if arm.task not in pretrained), keep)
        choices = settle(arms, pretrained, lambda arm: choose(self._ledger, arm, self._ledger.planned(SOURCE)))
        return ranked(self._space, choices, self._results)

    def transfer(self, choices: Sequence[Choices]) -> None:
        """Run stage 2. The transfers of a failed source fail with it; the others run."""
        self._run(TRANSFER, transfer_arms(self._space, choices, self._settings.params), keep=False)

    def confirm(self, choices: Sequence[Choices]) -> None:
        """Run what stage 2 has selected on unseen seeds, where the search space asks for it."""
        space, settings, ledger = self._space, self._settings, self._ledger
        if space.confirm is None:
            ledger.forget(CONFIRMATION)
            return
        from orchestrator.analysis.confirmation import chosen

        sources = confirm_source_arms(space, choices, settings.pretrained)
        self._run(CONFIRM_SOURCE, distinct(arm for by_task in sources for arm in by_task.values()), keep=True)
        unseen = with_unseen(choices, sources, ledger.source_runs)
        self._run(CONFIRM, confirm_arms(space, unseen, settings.params, chosen(self._results.rows())), keep=False)

    def _run(self, stage: str, arms: Sequence[Arm], keep: bool) -> None:
        """Plan a stage and run its missing cells."""
        ledger, search = self._ledger, self._space.search
        arms = [_drawn(arm, self._space) if arm.ranges and search.method == "random" else arm for arm in arms]
        lost = {cell.id: (cell, arm.lost) for arm in arms if arm.lost for cell in arm.some_cells()}
        sound = [arm for arm in arms if not arm.lost]
        tuned = [arm for arm in sound if arm.ranges]
        searched = [cell for arm in tuned for cell in ledger.searched(arm)]
        grids = [cell for arm in sound for cell in arm.all_cells()]
        cells = ledger.plan(stage, [*grids, *searched, *(cell for cell, _ in lost.values())], arms)
        self._tally.reused += sum(ledger.ended(cell, keep) and not ledger.new(cell) for cell in cells)
        lost = {key: lost[key] for key in lost.keys() - {cell.id for cell in (*grids, *searched)}}
        self._stages.lose(stage, [(cell, why) for cell, why in lost.values() if not ledger.ended(cell)])
        missing = [cell for cell in cells if not ledger.ended(cell, keep)]
        work = Work(stage, sound, missing, keep, whole=stage in CONFIRMATION)
        if work.missing or tuned:
            self._stages.run(work)


def _untrained(arm: Arm) -> SourceChoice:
    return untrained(arm, PLACEHOLDER_STEPS)


def _drawn(arm: Arm, space: SearchSpace) -> Arm:
    """Return the arm with its ranges replaced by random draws from them."""
    from orchestrator.planning.search import draw

    return replace(arm, grid=tuple(draw(arm, space.search)), ranges={})
