"""Selection of the best hyperparameters of each arm."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import pandas as pd

from orchestrator.analysis import statistics
from orchestrator.analysis.groups import Group
from orchestrator.analysis.per_seed import per_seed
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
    aucs = {key: per_seed(cells[cells["group"] == key]).set_index("seed")["auc"] for key in (group.id, best.id)}
    seeds = sorted(set(group.seeds) & set(best.seeds))
    gap = statistics.difference([aucs[best.id][s] for s in seeds], [aucs[group.id][s] for s in seeds])
    return gap.low is None or gap.low <= 0
