"""The analysis of a sweep's tables, computed once for figures, the report, exports and MLflow."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import pandas as pd

from orchestrator.analysis.confirmation import attach, split
from orchestrator.analysis.contrasts.contrast import Contrast, Measure, contrasts, every_pair
from orchestrator.analysis.contrasts.decisions import Decision, replay
from orchestrator.analysis.curves import milestones
from orchestrator.analysis.groups import Group, groups
from orchestrator.analysis.labels import shared
from orchestrator.analysis.over_tasks import OverTasks, over_tasks
from orchestrator.analysis.selection import Selected, select
from orchestrator.planning.arms import Key
from orchestrator.results.sweep_folder import Results
from trainables.errors import InputError, unknown
from trainables.plugins.names import short


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
    contrasts: list[Contrast]
    """The comparisons that are shown where nobody asks, corrected together: the sweep's family. What was confirmed is
    compared on the unseen seeds."""
    confirmations: list[Group] = field(default_factory=list)
    """What was run on unseen seeds: the selected configurations, and the baselines that they are compared with."""

    @cached_property
    def decisions(self) -> tuple[Decision, ...]:
        """The decisions of the sequential test over seeds; none where the seeds are fixed."""
        return replay(self.results.space(), self.cells).decisions

    @cached_property
    def each_cell(self) -> pd.DataFrame:
        """One row per planned cell."""
        return self.cells.drop_duplicates("cell_id") if len(self.cells) else self.cells

    @cached_property
    def common(self) -> Mapping[str, Any]:
        """The non-default hyperparameters that all configurations share; tables state them once, not in every row."""
        return shared(self.groups)

    @cached_property
    def over_tasks(self) -> OverTasks:
        """Its agents over all tasks that the search space has reference values for."""
        return over_tasks(self.best, self.cells, self.results.space().normalise)

    def done(self, group: Group) -> pd.DataFrame:
        """Return the rows of the cells table that are a group's and are done."""
        return self.cells[(self.cells["group"] == group.id) & (self.cells["status"] == "done")]

    def contrast(
        self, first: str | None = None, second: str | None = None, every: bool = False, measure: Measure = "auc"
    ) -> list[Contrast]:
        """Return the contrasts that somebody asks for, by the agents' names, corrected for how many they are.

        Without names: the sweep's family, or every pair. Raises InputError for what is no agent of the sweep, for one
        agent alone or twice, and where there is nothing to contrast.
        """
        pairs = self._pairs(first, second, every)
        if pairs is None and measure == "auc":
            found = self.contrasts
        else:
            found = contrasts(self._compared, [*self.groups, *self.confirmations], self.cells, pairs, measure)
        if not found:
            raise InputError(
                f"the sweep '{self.results.name}' has no two agents with a seed in common on the same target and source"
            )
        return found

    def _pairs(self, first: str | None, second: str | None, every: bool) -> list[tuple[str, str]] | None:
        """Return the pairs of agents that are meant; None: the sweep's family."""
        agents = list(dict.fromkeys(group.agent for group in self.best))
        there = {short(agent): agent for agent in agents} | {agent: agent for agent in agents}
        for name in (first, second):
            if name is not None and name not in there:
                raise unknown(f"agent of {self.results.name} with every seed done", name, there)
        if first is not None and every:
            raise InputError(f"every pair of agents, or one (got {first})")
        if first is None or second is None:
            if first is not None:
                raise InputError(f"a contrast is of two agents, such as delta_es es (got {first} alone)")
            return every_pair(agents) if every else None
        if there[first] == there[second]:
            raise InputError(f"a contrast is of two agents that differ (got {first} twice)")
        return [(there[first], there[second])]

    @property
    def _compared(self) -> list[Group]:
        """The best configuration of each arm, on the unseen seeds where it was confirmed."""
        return [group.judged for group in self.best]

    @property
    def best(self) -> list[Group]:
        """The best configuration of each arm."""
        return [selected.best for selected in self.selected.values()]


def find(results: Results, tables: tuple[pd.DataFrame, pd.DataFrame] | None = None) -> Findings:
    """Return the findings of a sweep; `tables` are its (cells, points) if they are loaded already."""
    cells, points = tables or results.tables()
    cells = milestones.add(cells, points)
    selecting, confirming = split(cells)
    every, confirmations = groups(selecting), groups(confirming)
    every, selected = attach(every, select(every, selecting), confirming)
    family = contrasts([each.best.judged for each in selected.values()], [*every, *confirmations], cells)
    final = {group.id: group for group in _judged([*every, *confirmations], selected.values(), family)}
    return Findings(
        results,
        cells,
        points,
        [final[group.id] for group in every],
        {
            key: replace(each, best=final[each.best.id], ties=tuple(final[tie.id] for tie in each.ties))
            for key, each in selected.items()
        },
        [replace(each, first=final[each.first.id], second=final[each.second.id]) for each in family],
        [final[group.id] for group in confirmations],
    )


def _judged(every: Iterable[Group], selected: Iterable[Selected], family: Iterable[Contrast]) -> list[Group]:
    """Return the groups with what the sweep as a whole says of each: its selection, and its corrected comparison."""
    tried = {each.best.id: each.tried for each in selected}
    corrected = {each.first.id: each.corrected for each in family if each.first.base_id == each.second.id}

    def judged(group: Group) -> Group:
        confirmed = replace(group.confirmed, corrected=corrected.get(group.confirmed.id)) if group.confirmed else None
        return replace(group, tried=tried.get(group.id, 1), corrected=corrected.get(group.id), confirmed=confirmed)

    return [judged(group) for group in every]
