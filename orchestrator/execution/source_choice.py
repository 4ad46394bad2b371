"""Choosing the source of a scenario once its stage 1 has ended."""

from __future__ import annotations

from collections.abc import Iterable

from orchestrator.analysis.groups import groups
from orchestrator.analysis.selection import select
from orchestrator.errors import SweepError
from orchestrator.execution.ledger import Ledger
from orchestrator.planning.arms import Pair
from orchestrator.planning.plan import SOURCE
from orchestrator.planning.source_choice import SourceChoice
from trainables.cell import Cell


def choose(ledger: Ledger, pair: Pair, planned: Iterable[Cell]) -> SourceChoice:
    """The outcome of stage 1 for one source's pair, whose cells are among `planned` and have ended.

    Raises SweepError where no configuration has all its seeds.
    """
    cells = [cell for cell in planned if pair.owns(cell)]
    table = ledger.table(cells, SOURCE)
    selected = select(groups(table), table).get(pair.key)
    if selected is None:
        errors = table["error"].dropna()
        why = f"; the first error: {errors.iloc[0]}" if len(errors) else ""
        raise SweepError(f"no configuration of {pair.agent} on the source task {pair.task} has all its seeds{why}")
    best = {name: value for name, value in selected.best.hyperparameters.items() if name in pair.swept}
    chosen = [cell for cell in cells if cell.group == selected.best.id]
    return SourceChoice(best, {cell.seed: ledger.source_run(cell) for cell in chosen})
