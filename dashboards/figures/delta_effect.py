"""Delta against the transfer effect: does max |delta| predict whether the source helps? (Figure 1, generalised)."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from dashboards.figure_model import Absent, Chart, Level, Panel, Series
from dashboards.labels import SOURCES, in_order, kinds
from orchestrator.analysis import statistics
from orchestrator.analysis.findings import Findings
from orchestrator.analysis.groups import Group
from orchestrator.analysis.statistics import Estimate
from trainables.agents.registry import agent_named

NAME, TITLE = "delta_effect", "Delta against transfer effect"
DEEP = "final_delta_p90"


NEAR = (0.45, 0.12)
"""Shares of a panel's width and height within which two names would overlap."""


MAX_LETTERS = 24
"""Next to a point."""

MAX_NAMED = 6
"""Targets named next to their points; with more, the names appear only under the mouse."""


@dataclass(frozen=True)
class Pair:
    """The size of delta and the transfer effect of one configuration on one target."""

    group: Group
    delta: float
    """max |delta| at the end of training; for deep agents the 90 % quantile of max_a |delta| over a minibatch."""
    ratio: tuple[float, float, float]
    """Transfer ratio in percent: value, low, high (all equal where there are too few seeds for an interval)."""


@dataclass(frozen=True)
class Correlation:
    """Spearman's rank correlation of delta with the transfer ratio, over the targets of one agent."""

    agent: str
    source: str
    targets: int
    rho: Estimate | None
    """None for fewer than three targets, or where delta or the ratio is the same on all."""


def pairs(findings: Findings) -> list[Pair]:
    """Return the best configurations that have both a delta and a defined transfer ratio."""
    deep = {}
    if DEEP in findings.cells:
        done = findings.cells[findings.cells["status"] == "done"].dropna(subset=[DEEP])
        deep = done.groupby("group")[DEEP].mean().to_dict()
    found = []
    for group in in_order(findings.best):
        delta = learned.value if (learned := group.estimate("max_abs_delta")) else deep.get(group.id)
        ratio = group.against_base.transfer_ratio if group.against_base else None
        if delta is not None and ratio is not None and ratio.value is not None:
            low, high = (ratio.value if end is None else end for end in (ratio.low, ratio.high))
            found.append(Pair(group, float(delta), (100 * ratio.value, 100 * low, 100 * high)))
    return found


def correlations(found: Sequence[Pair]) -> list[Correlation]:
    """Return the correlation over targets of each agent and kind of source."""
    keys = dict.fromkeys((pair.group.agent, pair.group.source) for pair in found)
    result = []
    for agent, source in keys:
        mine = [pair for pair in found if (pair.group.agent, pair.group.source) == (agent, source)]
        rho = statistics.rank_correlation([pair.delta for pair in mine], [pair.ratio[0] for pair in mine])
        result.append(Correlation(agent, source, len(mine), rho))
    return result


def chart(findings: Findings) -> Chart | Absent:
    """Return the figure: a panel per kind of source and scale of delta, a point per agent and target."""
    found = pairs(findings)
    if not found:
        reason = "No configuration with every seed done has both an estimate of delta and a defined transfer ratio."
        return Absent(NAME, TITLE, reason)
    panels = []
    for source in kinds(pair.group for pair in found):
        for kind in ("tabular", "deep"):
            here = [
                pair for pair in found if pair.group.source == source and agent_named(pair.group.agent).kind == kind
            ]
            if here:
                panels.append(_panel(source, kind, here))
    caption = "A point per agent and target, 95 % interval of the transfer ratio. Along the axis: max |delta| as the "
    caption += "agent estimates it at the end of training (deep agents: the 90 % quantile over a minibatch of states)."
    if any(one.hollow for panel in panels for one in panel.series):
        caption += " Hollow: the exact maximum over all states and actions."
    alt = f"Transfer ratio against max |delta| for {len(found)} pairs of agent and target."
    return Chart(NAME, TITLE, caption, alt, tuple(panels))


def _panel(source: str, kind: str, here: Sequence[Pair]) -> Panel:
    series = []
    for agent in dict.fromkeys(pair.group.agent for pair in here):
        mine = [pair for pair in here if pair.group.agent == agent]
        x, y = tuple(pair.delta for pair in mine), tuple(pair.ratio[0] for pair in mine)
        band = (tuple(pair.ratio[1] for pair in mine), tuple(pair.ratio[2] for pair in mine))
        tasks = tuple(pair.group.task for pair in mine)
        names = _names(mine, here) if _direct(agent) and len(mine) <= MAX_NAMED else ()
        series.append(Series(agent, agent, x, y, band, form="points", names=names, hover=tasks))
        if _direct(agent) and source == "exact":
            exact = tuple(largest_delta(pair.group) for pair in mine)
            series.append(
                Series(agent, f"{agent}, exact max |delta|", exact, y, form="points", hollow=True, hover=tasks)
            )
    x_title = "max |delta|" if kind == "tabular" else "90 % quantile of max |delta|"
    reach = [
        _reach(one for pair in here for one in pair.ratio),
        _reach(v for s in series for v in s.x if v is not None),
    ]
    level = (Level(0.0),)
    title = SOURCES.get(source, source)
    return Panel(title, x_title, "transfer ratio (%)", tuple(series), levels=level, y_range=reach[0], x_range=reach[1])


def _direct(agent: str) -> bool:
    """Return whether an agent follows its source in every step, so that its ratio is that of the source's policy."""
    return getattr(agent_named(agent).hyperparameters, "reuse", None) == "always"


def _reach(values: Iterable[float]) -> tuple[float, float]:
    """Return (low, high) of an axis: the range of the values, and space for the names next to the points."""
    every = list(values)
    room = 0.16 * (max(every) - min(every) or 1.0)
    return min(every) - room, max(every) + room


def _names(mine: Sequence[Pair], here: Sequence[Pair]) -> tuple[str, ...]:
    """Return a name per point; points close together share one, or have none where it would be too long."""
    wide = max(pair.delta for pair in here) - min(pair.delta for pair in here) or 1.0
    tall = max(pair.ratio[0] for pair in here) - min(pair.ratio[0] for pair in here) or 1.0
    names: list[list[str]] = []
    for at, pair in enumerate(mine):
        near = (
            other
            for other in range(at)
            if names[other]
            and abs(mine[other].delta - pair.delta) < NEAR[0] * wide
            and abs(mine[other].ratio[0] - pair.ratio[0]) < NEAR[1] * tall
        )
        first = next(near, None)
        names.append([short(pair.group)] if first is None else [])
        if first is not None:
            names[first].append(short(pair.group))
    joined = [", ".join(words) for words in names]
    return tuple(name if len(name) <= MAX_LETTERS else "" for name in joined)


def short(group: Group) -> str:
    """Return what distinguishes the target from the source."""
    return group.task.partition(":")[2].removeprefix("wind=") or "the source itself"


def largest_delta(group: Group) -> float:
    """Return the exact max |delta| between a configuration's source and target."""
    import numpy as np

    from trainables.delta.exact import exact_delta, exact_q
    from trainables.tasks.registry import model_of

    assert group.source_task is not None
    gamma = float(group.hyperparameters["gamma"])
    return float(np.abs(exact_delta(model_of(group.task), exact_q(group.source_task, gamma), gamma)).max())
