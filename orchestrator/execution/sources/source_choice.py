"""Chooses the source of a scenario once its stage 1 has ended."""

from __future__ import annotations

from collections.abc import Iterable

from orchestrator.execution.cells.ledger import Ledger
from orchestrator.planning.arms import Arm
from orchestrator.planning.plan import SOURCE
from orchestrator.planning.source_choice import SourceChoice, untrained
from trainables.cell import Cell


def choose(ledger: Ledger, arm: Arm, planned: Iterable[Cell]) -> SourceChoice:
    """Return the outcome of stage 1 for a source's arm, whose cells are among `planned` and have ended.

    Where no configuration has all its seeds, the source is lost, and `SourceChoice.lost` says why.
    """
    from orchestrator.analysis.groups import groups
    from orchestrator.analysis.selection import select

    cells = [cell for cell in planned if arm.owns(cell)]
    table = ledger.table(cells, SOURCE)
    selected = select(groups(table), table).get(arm.key)
    if selected is None:
        errors = table["error"].dropna() if len(table) else table
        why = f"; the first error: {errors.iloc[0]}" if len(errors) else ""
        lost = f"no configuration of {arm.agent} on the source task {arm.task} has all its seeds{why}"
        return untrained(arm, lost=lost)
    best = {name: value for name, value in selected.best.hyperparameters.items() if name in arm.swept}
    chosen = [cell for cell in cells if cell.group == selected.best.id]
    return SourceChoice(best, {cell.seed: ledger.source_run(cell) for cell in chosen})
