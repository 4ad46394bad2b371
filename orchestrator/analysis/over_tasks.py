"""Agents over all tasks of a sweep: normalised scores, their aggregates, and who is likelier to be better."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
import pandas as pd

from orchestrator.analysis.contrasts.contrast import of_interest
from orchestrator.analysis.curves.milestones import EARLY
from orchestrator.analysis.groups import Group
from orchestrator.analysis.inference import across_tasks, crossed
from orchestrator.analysis.inference.across_tasks import Scores
from orchestrator.analysis.statistics import Estimate
from trainables.tasks.registry import parse_task

References = Mapping[str, tuple[float, float]]
"""Task, or the name of a task family for all of its tasks, to the returns that count as 0 and as 1."""


class Entrant(NamedTuple):
    """What competes over all tasks."""

    agent: str
    source: str = "none"
    """learned, exact or none."""
    pick: str = ""
    source_task: str = ""
    """Where the sweep has several sources for one target; else empty."""


@dataclass(frozen=True, eq=False)
class Standing:
    """An entrant with its scores on every task."""

    entrant: Entrant
    scores: Scores
    """A table (sources, seeds) per task, of normalised AUCs."""
    early: Scores | None
    """The same of the AUC until the advice ends; None where a task has none."""
    worst: tuple[str, Estimate] | None
    """The task with the least difference from the agent without transfer, and that difference in normalised AUC."""

    @cached_property
    def aggregates(self) -> dict[str, Estimate]:
        """Every aggregate by name, each with its interval by stratified bootstrap."""
        found = {name: aggregate(self.scores) for name, aggregate in AGGREGATES.items()}
        return found | ({"early_iqm": across_tasks.iqm(self.early)} if self.early else {})


AGGREGATES = {
    "iqm": across_tasks.iqm,
    "mean": across_tasks.mean,
    "median": across_tasks.median,
    "optimality_gap": across_tasks.optimality_gap,
}


@dataclass(frozen=True)
class Improvement:
    """P(a run of A beats one of B on the same task), averaged over tasks."""

    first: Entrant
    second: Entrant
    estimate: Estimate


@dataclass(frozen=True, eq=False)
class OverTasks:
    """A sweep over all tasks that have reference values."""

    tasks: tuple[str, ...]
    standings: tuple[Standing, ...]
    left_out: tuple[Entrant, ...]
    """What has no best configuration on some of the tasks."""

    @cached_property
    def improvements(self) -> list[Improvement]:
        """Each entrant against those that it builds on and the agent without transfer, where both are here."""
        of = {standing.entrant: standing for standing in self.standings}
        found = []
        for first, second in _pairs(of):
            chance = across_tasks.improvement(of[first].scores, of[second].scores)
            found.append(Improvement(first, second, chance))
        return found


def over_tasks(best: Sequence[Group], cells: pd.DataFrame, references: References) -> OverTasks:
    """Return the standings of the best configurations of a sweep's transfer stage."""
    groups = [group.judged for group in best if group.stage == "transfer"]
    named = dict.fromkeys(group.task for group in groups)
    known = {task: pair for task in named if (pair := reference(task, references)) is not None}
    entrants: dict[Entrant, dict[str, Group]] = {}
    several = _several(groups)
    for group in groups:
        if group.task in known:
            entrants.setdefault(_entrant(group, several), {})[group.task] = group
    whole = {entrant: found for entrant, found in entrants.items() if len(found) == len(known)}
    done = cells[cells["status"] == "done"] if len(cells) else cells
    frames = {str(name): frame for name, frame in done.groupby("group")} if len(done) else {}
    return OverTasks(
        tuple(known),
        tuple(_standing(entrant, found, frames, known) for entrant, found in whole.items()),
        tuple(entrant for entrant in entrants if entrant not in whole),
    )


def reference(task: str, references: References) -> tuple[float, float] | None:
    """Return the returns that count as 0 and 1 on a task: its own, else its family's; None where there are none."""
    return references.get(task) or references.get(parse_task(task).family.name)


def _several(groups: Iterable[Group]) -> set[tuple[str, str, str]]:
    """Return the (agent, kind, pick) that have several sources on one target."""
    seen: dict[tuple[str, str, str, str], set[str]] = {}
    for group in groups:
        seen.setdefault((group.agent, group.source, group.pick, group.task), set()).add(group.source_task or "")
    return {key[:3] for key, sources in seen.items() if len(sources) > 1}


def _entrant(group: Group, several: set[tuple[str, str, str]]) -> Entrant:
    key = group.agent, group.source, group.pick
    return Entrant(*key, (group.source_task or "") if key in several else "")


def _standing(
    entrant: Entrant, groups: Mapping[str, Group], frames: Mapping[str, pd.DataFrame], references: References
) -> Standing:
    def scores(column: str) -> list[crossed.Table]:
        return [
            (crossed.rectangle(frames[groups[task].id], column) - low) / (high - low)
            for task, (low, high) in references.items()
        ]

    of = [frames[group.id] for group in groups.values()]
    early = all(EARLY in frame and frame[EARLY].notna().all() for frame in of)
    return Standing(entrant, scores("auc"), scores(EARLY) if early else None, _worst(groups, references))


def _worst(groups: Mapping[str, Group], references: References) -> tuple[str, Estimate] | None:
    scaled = {}
    for task, (low, high) in references.items():
        against = groups[task].against_base
        if against is None:
            return None
        gap = against.difference
        bottom, top = (None if end is None else end / (high - low) for end in (gap.low, gap.high))
        scaled[task] = Estimate(gap.value / (high - low), bottom, top, p=gap.p, df=gap.df)
    task = min(scaled, key=lambda name: scaled[name].value)
    return task, scaled[task]


def _pairs(entrants: Iterable[Entrant]) -> list[tuple[Entrant, Entrant]]:
    """Return the pairs of entrants whose agents are of interest, with the same source or one without."""
    there = list(entrants)
    found = []
    for agents in _interest(there):
        for first in (entrant for entrant in there if entrant.agent == agents[0]):
            rivals = [entrant for entrant in there if entrant.agent == agents[1]]
            same = [rival for rival in rivals if rival[1:] == first[1:]]
            found += [(first, rival) for rival in same or rivals if rival.source == "none" or rival in same]
    return found


def _interest(entrants: Iterable[Entrant]) -> list[tuple[str, str]]:
    return of_interest(entrant.agent for entrant in entrants)


def number_table(found: OverTasks) -> pd.DataFrame:
    """Return a row per entrant: every aggregate with its interval, and the worst task."""
    return pd.DataFrame([_numbers(standing, len(found.tasks)) for standing in found.standings])


def _numbers(standing: Standing, tasks: int) -> dict[str, Any]:
    entrant = standing.entrant
    record: dict[str, Any] = {"agent": entrant.agent, "source": entrant.source, "pick": entrant.pick or None}
    record |= {"source_task": entrant.source_task or None, "tasks": tasks}
    record["runs"] = int(sum(table.size for table in standing.scores))
    for name in (*AGGREGATES, "early_iqm"):
        estimate = standing.aggregates.get(name)
        record |= _ends(name, estimate)
    return (
        record
        | {"worst_task": standing.worst[0] if standing.worst else None}
        | _ends("worst_difference", standing.worst[1] if standing.worst else None)
    )


def _ends(name: str, estimate: Estimate | None) -> dict[str, float]:
    values = (None,) * 3 if estimate is None else (estimate.value, estimate.low, estimate.high)
    return {
        f"{name}{end}": np.nan if value is None else value
        for end, value in zip(("", "_low", "_high"), values, strict=True)
    }
