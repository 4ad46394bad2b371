"""A sweep: stage 1 trains the sources, stage 2 the transfers; what is done already is never run again."""

from __future__ import annotations

import itertools
import time
from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import replace
from typing import Any

from rich.console import Console

from orchestrator.errors import InterruptedSweepError, SweepError
from orchestrator.execution.ledger import Ledger
from orchestrator.execution.settings import Settings, Tally
from orchestrator.execution.source_choice import choose
from orchestrator.execution.stage import OnRecord, Stages, Work
from orchestrator.planning import source_choice
from orchestrator.planning.arms import Pair
from orchestrator.planning.plan import SOURCE, TRANSFER, library_pairs, source_pairs, transfer_pairs
from orchestrator.planning.source_choice import SourceChoice
from orchestrator.results.lock import locked
from orchestrator.results.sweep_folder import Results


def run(
    results: Results, settings: Settings, console: Console, on_record: OnRecord = lambda stage, record: None
) -> Tally:
    """Run what is missing of a sweep, telling `on_record` of each cell as it ends.

    After Ctrl-C or SIGTERM the tally says in `left` how many cells are left. Raises InputError for a damaged record, a
    sweep that another driver is at, or a cell that fits on no node; SweepError where no configuration of a source is
    complete, a record cannot be written or the cluster is gone.
    """
    started = time.monotonic()
    with locked(results.folder), ExitStack() as stack:
        ledger, tally = Ledger(results, settings.retry_failed), Tally()
        if ledger.damaged:
            console.print(f"{ledger.damaged}: their cells are run again", style="yellow", soft_wrap=True)
        sweep = _Sweep(
            results, settings, ledger, tally, Stages(results, settings, ledger, tally, console, on_record, stack)
        )
        try:
            sweep.transfer(sweep.train_sources())
        except InterruptedSweepError:
            tally.left = sum(not ledger.ended(cell) for stage in (SOURCE, TRANSFER) for cell in ledger.planned(stage))
        except OSError as error:
            raise SweepError(f"cannot write to {results.folder} ({error}); all earlier records are kept") from error
        ledger.close()
    tally.seconds = time.monotonic() - started
    return tally


class _Sweep:
    """The two stages of one run."""

    def __init__(self, results: Results, settings: Settings, ledger: Ledger, tally: Tally, stages: Stages) -> None:
        self._space, self._params, self._given = results.space(), settings.params, settings.given
        self._ledger, self._tally, self._stages = ledger, tally, stages

    def train_sources(self) -> list[SourceChoice]:
        """Stage 1: the outcome of each scenario's source."""
        pairs = source_pairs(self._space, self._params)
        libraries = library_pairs(self._space, self._params)
        keep = any("learned" in scenario.source.kinds for scenario in self._space.scenarios)
        every = itertools.chain(pairs, *libraries)
        self._run(SOURCE, [pair for pair in every if pair is not None and pair.task not in self._given], keep)
        return [
            replace(self._choice(pair), library=tuple(self._choice(other) for other in library))
            for pair, library in zip(pairs, libraries, strict=True)
        ]

    def _choice(self, pair: Pair | None) -> SourceChoice:
        """The outcome of stage 1 for one source."""
        if pair is None:
            return SourceChoice({}, {})
        if pair.task in self._given:
            return source_choice.choice(pair, self._given[pair.task])
        return choose(self._ledger, pair, self._ledger.planned(SOURCE))

    def transfer(self, choices: Sequence[SourceChoice]) -> None:
        """Stage 2."""
        self._run(TRANSFER, transfer_pairs(self._space, choices, self._params), keep=False)

    def _run(self, stage: str, pairs: Sequence[Pair], keep: bool) -> None:
        """Plan a stage and run what it lacks."""
        ledger, search = self._ledger, self._space.search
        pairs = [_drawn(pair, self._space) if pair.ranges and search.method == "random" else pair for pair in pairs]
        tuned = [pair for pair in pairs if pair.ranges]
        searched = [cell for pair in tuned for cell in ledger.searched(pair)]
        cells = ledger.plan(stage, [*(cell for pair in pairs for cell in pair.all_cells()), *searched])
        self._tally.reused += sum(ledger.ended(cell, keep) and not ledger.new(cell) for cell in cells)
        work = Work(stage, pairs, [cell for cell in cells if not ledger.ended(cell, keep)], keep)
        if work.missing or tuned:
            self._stages.run(work)


def _drawn(pair: Pair, space: Any) -> Pair:
    """The pair with its ranges replaced by random draws from them."""
    from orchestrator.planning.search import draw

    return replace(pair, grid=tuple(draw(pair, space.search)), ranges={})
