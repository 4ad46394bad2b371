"""The verdict of the report: how often transfer helped or hurt, and the clearest cases of both."""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Sequence
from dataclasses import dataclass
from typing import Literal

from dashboards.labels import SOURCES, count, label, minus
from dashboards.report.tables import mark
from orchestrator.analysis.contrasts.table import comparisons
from orchestrator.analysis.findings import Findings
from orchestrator.analysis.groups import Group
from orchestrator.analysis.metrics import DIFFERENCE, TRANSFER_RATIO, signed

STATUSES = ("done", "failed", "missing", "stopped")

HEADLINES = 3
"""Most cases of each direction."""


@dataclass(frozen=True)
class Headline:
    """One of the clearest cases in which transfer helped or hurt."""

    task: str
    agent: str
    what: str
    """The configuration and its source."""
    effect: str
    """Its transfer ratio, else the difference in AUC."""
    evidence: str
    """The interval, and both AUCs."""
    mark: str
    """helped or hurt, with a ? where that does not hold after the correction for all comparisons of the sweep."""
    remark: str = ""
    """How it compares with the agent's best configuration."""


@dataclass(frozen=True)
class Direction:
    """The clearest cases in which transfer helped, or hurt, the clearest first."""

    verdict: Literal["helped", "hurt"]
    headlines: tuple[Headline, ...]


@dataclass(frozen=True)
class Verdict:
    """The result of a sweep in a few lines."""

    helped: int
    hurt: int
    undecided: int
    held: int
    """Those helped or hurt for which that holds after the correction for all comparisons of the sweep."""
    comparisons: int
    """How many those are."""
    cells: str
    """The number of seeds and cells, as text."""
    directions: tuple[Direction, ...]
    """That of the clearest case first; a direction without a case is left out."""
    winners: tuple[tuple[str, str, str], ...]
    """(target, agent, sentence) of the best on each target."""


def verdict(findings: Findings, winners: Sequence[Group]) -> Verdict:
    """Return how often transfer helped and hurt, the clearest cases of both, and the best on each target."""
    counts = Counter(group.judged.verdict for group in findings.best)
    surest = {which: _surest(findings, which) for which in ("helped", "hurt")}
    directions = [
        Direction(which, tuple(_headline(group, findings) for group in groups))  # type: ignore[arg-type]
        for which, groups in sorted(surest.items(), key=lambda found: -max(map(sureness, found[1]), default=0.0))
        if groups
    ]
    best = tuple((group.task, group.agent, _sentence(group, findings.common)) for group in winners)
    decided = [group.judged for group in findings.best if group.judged.verdict in ("helped", "hurt")]
    held = sum(group.corrected is not None and group.corrected.holds for group in decided)
    three = counts["helped"], counts["hurt"], counts["undecided"]
    return Verdict(*three, held, comparisons(findings.contrasts), _cells(findings), tuple(directions), best)


def sureness(group: Group) -> float:
    """Return how far the nearer end of the transfer ratio's interval is from 0; 0 where there is no interval."""
    against = group.judged.against_base
    ratio = against.transfer_ratio if against else None
    if ratio is None or ratio.low is None or ratio.high is None:
        return 0.0
    return max(ratio.low, -ratio.high, 0.0)


def _surest(findings: Findings, which: str) -> list[Group]:
    """Return the clearest configuration of each agent, target and source; losses need not be its best configuration."""
    candidates = findings.best if which == "helped" else [group for group in findings.groups if group.complete]
    found: dict[object, Group] = {}
    for group in sorted(candidates, key=lambda group: -sureness(group)):
        if group.judged.verdict == which:
            found.setdefault(group.key, group)
    return list(found.values())[:HEADLINES]


def _headline(group: Group, findings: Findings) -> Headline:
    judged = group.judged
    assert judged.against_base is not None
    assert judged.auc is not None
    ratio, gap = judged.against_base.transfer_ratio, judged.against_base.difference
    effect, interval = DIFFERENCE.text(gap), ""
    if ratio.value is not None:
        effect, _, interval = TRANSFER_RATIO.text(ratio).partition(" ")
    aucs = f"AUC {judged.auc.value:.2f} in place of {judged.auc.value - gap.value:.2f} without transfer"
    aucs += f", on {len(judged.seeds)} unseen seeds" if group.confirmed else ""
    evidence = minus(f"{interval} · {aucs}" if interval else aucs)
    source = f", {SOURCES[group.source]}" if group.source in SOURCES else ""
    what = label(group, findings.common) + source
    holds = judged.corrected is None or judged.corrected.holds
    remarks = ["" if holds else "not after Holm's correction", _remark(group, findings)]
    shown = mark(judged.verdict, holds)
    return Headline(group.task, group.agent, what, minus(effect), evidence, shown, "; ".join(filter(None, remarks)))


def _remark(group: Group, findings: Findings) -> str:
    """Return a remark on the agent's best configuration, where `group` is another one."""
    best = findings.selected[group.key].best if group.key in findings.selected else group
    against = best.judged.against_base
    if best.id == group.id or against is None:
        return ""
    ratio = against.transfer_ratio.value
    did = "" if ratio is None else f": {signed(100 * ratio)}%"
    return minus(f"its best configuration is {label(best, findings.common)}{did}")


def _cells(findings: Findings) -> str:
    counts = Counter(findings.each_cell["status"]) if len(findings.each_cell) else Counter()
    space = findings.results.space()
    seeds = (f"{space.sequential.group} to " if space.sequential else "") + count(len(space.seeds), "seed")
    if not counts:
        return f"{seeds}; no cell yet"
    if set(counts) == {"done"}:
        return f"{seeds}; all {counts['done']} cells are done" if counts["done"] > 1 else f"{seeds}; 1 cell, done"
    return f"{seeds}; of {sum(counts.values())} cells " + ", ".join(
        f"{counts[name]} {name}" for name in STATUSES if counts[name]
    )


def _sentence(group: Group, hide: Collection[str]) -> str:
    source = f", {SOURCES[group.source]}" if group.source in SOURCES else ""
    name = label(group, hide)
    judged = group.judged
    text = f"{name}{source}: AUC {judged.auc.value:.2f}" if judged.auc else name
    text += f" on {len(judged.seeds)} unseen seeds" if group.confirmed else ""
    if judged.against_base is None:
        return minus(text) + "; no agent with transfer was better"
    gap, ratio = judged.against_base.difference, judged.against_base.transfer_ratio
    text += f", {DIFFERENCE.text(gap)}"
    text += "" if ratio.value is None else f" ({TRANSFER_RATIO.text(ratio)})"
    text += " compared with no transfer"
    return minus(text) + (", which is undecided with these seeds" if judged.verdict == "undecided" else "")
