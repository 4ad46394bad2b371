"""The analysis of a sweep's tables, computed once for figures, the report, exports and MLflow."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import pandas as pd

from orchestrator.analysis.confirmation import attach, split
from orchestrator.analysis.groups import Group, groups
from orchestrator.analysis.labels import shared
from orchestrator.analysis.selection import Selected, select
from orchestrator.planning.arms import Key
from orchestrator.results.sweep_folder import Results


@dataclass(frozen=True, eq=False)
class Findings:
    """A sweep's tables, its groups, and the best of them."""

    results: Results
    cells: pd.DataFrame
    """One row per planned cell, and per arm for a cell of several."""
    points: pd.DataFrame
    """One row per cell and evaluation point."""
    groups: list[Group]
    selected: dict[Key, Selected]
    """The best configuration of each arm, with its confirmation where there is one."""
    confirmations: list[Group] = field(default_factory=list)
    """What was run on unseen seeds: the selected configurations, and the baselines that they are compared with."""

    @cached_property
    def each_cell(self) -> pd.DataFrame:
        """One row per planned cell."""
        return self.cells.drop_duplicates("cell_id") if len(self.cells) else self.cells

    @cached_property
    def common(self) -> Mapping[str, Any]:
        """The non-default hyperparameters that all configurations share; tables state them once, not in every row."""
        return shared(self.groups)

    @property
    def best(self) -> list[Group]:
        """The best configuration of each arm."""
        return [selected.best for selected in self.selected.values()]


def find(results: Results, tables: tuple[pd.DataFrame, pd.DataFrame] | None = None) -> Findings:
    """Return the findings of a sweep; `tables` are its (cells, points) if they are loaded already."""
    cells, points = tables or results.tables()
    selecting, confirming = split(cells)
    every = groups(selecting)
    every, selected = attach(every, select(every, selecting), confirming)
    return Findings(results, cells, points, every, selected, groups(confirming))
