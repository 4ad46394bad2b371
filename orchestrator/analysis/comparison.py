"""Comparison of two sweeps: their best configurations, task by task."""

from __future__ import annotations

from dataclasses import dataclass, replace

from orchestrator.analysis.findings import Findings
from orchestrator.analysis.groups import Group
from orchestrator.analysis.inference.pairs import difference, paired
from orchestrator.analysis.selection import optimism
from orchestrator.analysis.statistics import Estimate


@dataclass(frozen=True)
class Row:
    """A task, agent and source that both sweeps have."""

    task: str
    agent: str
    source: str
    first: float
    """Mean AUC over the seeds of the first sweep."""
    second: float
    seeds: int
    """Seeds that both have."""
    difference: Estimate | None
    """Second - first, paired by those seeds; None where there are none."""
    confirmed: bool
    """Whether all of it is of unseen seeds: where both sweeps have confirmed what they selected."""
    verdict: str
    """higher, lower, the same, or undecided."""


@dataclass(frozen=True)
class SweepComparison:
    """The rows that two sweeps share, and the arms that only one of them has."""

    rows: tuple[Row, ...]
    only_first: tuple[str, ...]
    only_second: tuple[str, ...]
    note: str | None
    """What has to be said of configurations that their own seeds have selected; None where there are none."""


def compare(first: Findings, second: Findings) -> SweepComparison:
    """Return the comparison of the best configurations of two sweeps."""
    mine, theirs = ({key: selected.best for key, selected in each.selected.items()} for each in (first, second))
    rows = tuple(_row(mine[key], theirs[key], first, second) for key in mine if key in theirs)
    selecting = [
        group
        for key in mine
        if key in theirs and not _confirmed(mine[key], theirs[key])
        for group in (mine[key], theirs[key])
    ]
    return SweepComparison(
        rows,
        tuple(_name(group) for key, group in mine.items() if key not in theirs),
        tuple(_name(group) for key, group in theirs.items() if key not in mine),
        optimism([replace(group, confirmed=None) for group in selecting]),
    )


def _confirmed(mine: Group, theirs: Group) -> bool:
    """Return whether both sweeps have confirmed what they selected, so that unseen seeds can be paired."""
    return mine.confirmed is not None and theirs.confirmed is not None


def _name(group: Group) -> str:
    source = "" if group.source == "none" else f" ({group.source} source)"
    return f"{group.agent} on {group.task}{source}"


def _row(mine: Group, theirs: Group, first: Findings, second: Findings) -> Row:
    confirmed = _confirmed(mine, theirs)
    sides = (mine.judged, theirs.judged) if confirmed else (mine, theirs)
    before, after = (sweep.done(group) for sweep, group in zip((first, second), sides, strict=True))
    pairs = paired(after, before)
    gap = difference(pairs, "auc")
    return Row(
        mine.task,
        mine.agent,
        mine.source_label,
        first=float(before["auc"].mean()),
        second=float(after["auc"].mean()),
        seeds=int(pairs["seed"].nunique()),
        difference=gap,
        confirmed=confirmed,
        verdict=_verdict(gap),
    )


def _verdict(gap: Estimate | None) -> str:
    if gap is None:
        return "undecided"
    if gap.value == 0 and (gap.low, gap.high) in ((0, 0), (None, None)):
        return "the same"
    if gap.low is None or gap.high is None or gap.low <= 0 <= gap.high:
        return "undecided"
    return "higher" if gap.low > 0 else "lower"
