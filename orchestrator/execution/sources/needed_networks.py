"""Which source networks a sweep still asks for: a recorded source trains again only where a missing cell needs it."""

from __future__ import annotations

from orchestrator.execution.cells.ledger import Ledger
from orchestrator.execution.settings import Settings
from orchestrator.execution.sources.source_choice import choose
from orchestrator.planning.plan import source_arms, transfer_arms
from orchestrator.planning.source_choice import settle
from search_spaces.search_space import SearchSpace


def spare(space: SearchSpace, settings: Settings, ledger: Ledger) -> int:
    """Tell the ledger which of its sources need no network any more, and return how many have none.

    That is so after `deltatune restore`. Which source advises whom follows from the records of stage 1, unless one is
    missing, networks are ranked, or the transfers are not known beforehand (a search, a sequential test, a
    confirmation): then none is spared, nor with `--reuse none`.
    """
    arms = source_arms(space, settings.params)
    sources = [arm for by_task in arms for arm in by_task.values() if arm.task not in settings.pretrained]
    open_ended = (
        settings.reuse == "none"
        or space.sequential
        or space.confirm
        or any(each.source.whose == "ranked" for each in space.scenarios)
    )
    if open_ended or any(arm.ranges for arm in sources):
        return 0
    cells = {cell.id: cell for arm in sources for cell in arm.all_cells()}
    if not all(map(ledger.ended, cells.values())) or all(map(ledger.library.has, cells)):
        return 0
    choices = settle(arms, settings.pretrained, lambda arm: choose(ledger, arm, cells.values()))
    transfers = [arm for arm in transfer_arms(space, choices, settings.params) if not arm.lost]
    if any(arm.ranges for arm in transfers):
        return 0
    missing = [cell for arm in transfers for cell in arm.all_cells() if not ledger.ended(cell)]
    return ledger.spare(cells.keys() - {source.cell_id for cell in missing for source in cell.sources})
