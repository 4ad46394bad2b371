"""Selection of the best hyperparameters of each arm."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import pandas as pd

from orchestrator.analysis.groups import Group
from orchestrator.analysis.inference.pairs import difference, paired
from orchestrator.analysis.inference.seeds import whole_seeds
from orchestrator.planning.arms import Key

RULE = (
    "highest mean AUC over seeds, among configurations whose every seed is done; equal means: the first in the search "
    "space. A tie is a configuration whose paired difference in AUC from the best has an interval that touches 0."
)


@dataclass(frozen=True)
class Selected:
    """The best group of an arm, and the groups tied with it."""

    best: Group
    ties: tuple[Group, ...]
    tried: int
    """Configurations that took part."""
    left_out: int
    """Configurations with a seed that failed, is missing or was stopped early."""


def optimism(groups: Iterable[Group]) -> str | None:
    """Return the sentence that belongs beside best configurations that their own seeds have chosen, or None.

    It is due until they are confirmed: with four configurations of equal worth and five seeds, "helped" comes out in
    7 % of cases in place of 2.5 %; with twenty, in 15 to 18 %.
    """
    chosen = [group for group in groups if group.tried > 1 and not group.confirmed]
    if not chosen:
        return None
    tried = {group.tried for group in chosen}
    of = f"{'up to ' if len(tried) > 1 else ''}{max(tried)}"
    what = f"{len(chosen)} best configurations were each" if len(chosen) > 1 else "1 best configuration was"
    return (
        f"{what} chosen among {of} by the seeds that also judge {'them' if len(chosen) > 1 else 'it'}: AUC and "
        "difference are too favourable until confirmed on unseen seeds."
    )


def select(groups: Iterable[Group], cells: pd.DataFrame) -> dict[Key, Selected]:
    """Return the selection for every arm with at least one complete group."""
    byname: dict[Key, list[Group]] = {}
    for group in groups:
        byname.setdefault(group.key, []).append(group)
    selected = {}
    for key, members in byname.items():
        complete = [group for group in members if group.complete]
        if complete:
            best = max(complete, key=_score)
            ties = tuple(group for group in complete if group is not best and _tied(group, best, cells))
            selected[key] = Selected(best, ties, len(complete), len(members) - len(complete))
    return selected


def _score(group: Group) -> float:
    assert group.auc is not None
    return group.auc.value


def _tied(group: Group, best: Group, cells: pd.DataFrame) -> bool:
    pairs = paired(*(whole_seeds(cells[cells["group"] == key]) for key in (best.id, group.id)))
    gap = difference(pairs, "auc")
    return gap is None or gap.low is None or gap.low <= 0
