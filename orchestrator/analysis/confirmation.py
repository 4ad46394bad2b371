"""Which configurations a confirmation runs again, and what it found of them."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from typing import Any

import pandas as pd

from orchestrator.analysis.groups import Group, groups
from orchestrator.analysis.selection import Selected, select
from orchestrator.planning.arms import Key
from orchestrator.planning.confirmation import CONFIRMATION


def split(cells: pd.DataFrame) -> tuple[pd.DataFrame, pd.DataFrame]:
    """Return the cells that select a configuration, and those that confirm one."""
    if cells.empty:
        return cells, cells
    confirms = cells["stage"].isin(CONFIRMATION)
    return cells[~confirms], cells[confirms]


def chosen(rows: Iterable[dict[str, Any]]) -> dict[Key, list[dict[str, Any]]]:
    """Return arm to the configurations to confirm, by the rows of a cells table.

    These are the selected configuration of each arm of the transfer stage, and the baseline that it is compared with,
    which has its hyperparameters and need not be the baseline's own best.
    """
    table, _ = split(pd.DataFrame(list(rows)))
    every = groups(table)
    by_id = {group.id: group for group in every}
    found: dict[Key, list[dict[str, Any]]] = {}
    for selected in select(every, table).values():
        if selected.best.stage != "transfer":
            continue
        for group in (selected.best, by_id.get(selected.best.base_id)):
            if group is not None and dict(group.hyperparameters) not in found.setdefault(group.key, []):
                found[group.key].append(dict(group.hyperparameters))
    return found


def confirmed(selected: dict[Key, Selected], cells: pd.DataFrame) -> dict[Key, Group]:
    """Return arm to what the cells of a confirmation say of its selected configuration, where all of them are done."""
    there = {(group.key, _settings(group)): group for group in groups(cells) if group.complete}
    found = {key: there.get((key, _settings(one.best))) for key, one in selected.items()}
    return {key: group for key, group in found.items() if group is not None}


def attach(
    every: list[Group], selected: dict[Key, Selected], cells: pd.DataFrame
) -> tuple[list[Group], dict[Key, Selected]]:
    """Return groups and selection, with the confirmation of each selected configuration."""
    said = confirmed(selected, cells)
    new = {selected[key].best.id: replace(selected[key].best, confirmed=group) for key, group in said.items()}
    chosen = {key: replace(one, best=new.get(one.best.id, one.best)) for key, one in selected.items()}
    return [new.get(group.id, group) for group in every], chosen


def _settings(group: Group) -> str:
    return repr(sorted(group.hyperparameters.items()))
