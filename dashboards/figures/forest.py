"""Forest plot: the transfer ratio of every configuration with its interval, a panel per target."""

from __future__ import annotations

from collections.abc import Collection, Sequence

from dashboards.figure_model import Absent, Chart, Level, Panel, Series
from dashboards.labels import SOURCES, count, in_order, label, minus, targets
from orchestrator.analysis.findings import Findings
from orchestrator.analysis.groups import Group

NAME, TITLE = "forest", "Transfer ratios"

REACH = 150.0
"""Percent. A ratio beyond it is drawn at the edge, with its number."""

MAX_ROWS = 24
"""Of a panel: with more configurations on a target, only the best of each agent and source are drawn."""


def chart(findings: Findings) -> Chart | Absent:
    """Return the figure: a row per configuration with a defined transfer ratio."""
    panels, undefined, cut = [], 0, False
    best = {group.id for group in findings.best}
    for target in targets(findings):
        here = in_order(g for g in findings.groups if g.task == target and g.complete and g.against_base)
        defined = [group for group in here if _ratio(group) is not None]
        undefined += len(here) - len(defined)
        if len(defined) > MAX_ROWS:
            cut, defined = True, [group for group in defined if group.id in best]
        if defined:
            panels.append(_panel(target, defined[:MAX_ROWS], findings.common))
    if not panels:
        reason = "No configuration with every seed done has a defined transfer ratio"
        return Absent(NAME, TITLE, f"{reason} ({undefined} undefined)." if undefined else f"{reason}.")
    caption = "Transfer ratio with its 95 % interval; right of 0 the source helps. "
    caption += "The best configuration of each agent and source. " if cut else "Every configuration. "
    caption += f"A ratio beyond ±{REACH:.0f} % is drawn at the edge, with its number."
    caption += f" {count(undefined, 'undefined ratio')} left out." if undefined else ""
    alt = f"Forest plot of transfer ratios on {count(len(panels), 'target')}; the numbers are in the tables."
    return Chart(NAME, TITLE, caption, alt, tuple(panels))


def _ratio(group: Group) -> float | None:
    return group.against_base.transfer_ratio.value if group.against_base else None


def _panel(target: str, groups: Sequence[Group], hide: Collection[str]) -> Panel:
    ends = [value for group in groups for value in _ends(group)]
    low, high = max(min(*ends, 0.0), -REACH), min(max(*ends, 0.0), REACH)
    margin = 0.08 * max(high - low, 10.0)
    agents = dict.fromkeys(group.agent for group in groups)
    series = tuple(_series(agent, groups, hide) for agent in agents)
    return Panel(
        target,
        "transfer ratio (%)",
        "",
        series,
        target,
        (Level(0.0, upright=True),),
        y_ticks=tuple(f"{label(group, hide)}, {_source(group)}" for group in groups),
        x_range=(low - margin, high + margin),
    )


def _series(agent: str, groups: Sequence[Group], hide: Collection[str]) -> Series:
    """Return the points of one agent."""
    mine = [(float(place), group) for place, group in enumerate(groups) if group.agent == agent]
    values = [_ends(group) for _, group in mine]
    x, low, high = (tuple(_clip(value[end]) for value in values) for end in range(3))
    beyond = tuple("" if abs(value[0]) <= REACH else minus(f"{value[0]:+.0f} %") for value in values)
    hover = tuple(label(group, hide) for _, group in mine)
    y = tuple(place for place, _ in mine)
    names = beyond if any(beyond) else ()
    return Series(agent, agent, x, y, x_band=(low, high), form="points", names=names, hover=hover)


def _source(group: Group) -> str:
    return SOURCES[group.source].partition(" ")[0]


def _ends(group: Group) -> tuple[float, float, float]:
    """Return (value, low, high) in percent; all three are the value where there is no interval."""
    assert group.against_base is not None
    ratio = group.against_base.transfer_ratio
    assert ratio.value is not None
    low, high = (ratio.value if end is None else end for end in (ratio.low, ratio.high))
    return 100 * ratio.value, 100 * low, 100 * high


def _clip(value: float) -> float:
    return min(max(value, -REACH), REACH)
