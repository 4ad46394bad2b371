"""How well each measure of similarity predicts the transfer ratio: rank correlations with their intervals."""

from __future__ import annotations

from collections.abc import Mapping

from dashboards.figure_model import Chart, Level, Panel, Series
from orchestrator.analysis.metric_validity import NAMES
from orchestrator.analysis.statistics import Estimate

Found = Mapping[tuple[str, str, str], Estimate]
"""(source task, agent, measure) to its correlation, from `orchestrator.analysis.metric_validity.correlations`."""


def chart(found: Found) -> Chart:
    """Return the figure: a panel per source task, a row per measure and agent."""
    sources = list(dict.fromkeys(source for source, _, _ in found))
    return Chart(
        "metric_validity",
        "which measure predicts transfer?",
        "Spearman's rank correlation of nearness with the transfer ratio, 95 % bootstrap intervals over targets.",
        "Rank correlations of measures of similarity with transfer ratios; the numbers are in the table.",
        tuple(_panel(source, found) for source in sources),
    )


def _panel(source: str, found: Found) -> Panel:
    agents = list(dict.fromkeys(agent for named, agent, _ in found if named == source))
    rows = [(name, agent) for name in NAMES for agent in agents if (source, agent, name) in found]
    return Panel(
        f"source {source}",
        "rank correlation of nearness with the transfer ratio",
        "",
        tuple(_series(source, agent, rows, found) for agent in agents),
        levels=(Level(0.0, upright=True),),
        y_ticks=tuple(f"{NAMES[name]}: {agent}" for name, agent in rows),
        x_range=(-1.05, 1.05),
    )


def _series(source: str, agent: str, rows: list[tuple[str, str]], found: Found) -> Series:
    """Return the points of one agent."""
    mine = [(float(place), found[source, agent, name]) for place, (name, owner) in enumerate(rows) if owner == agent]
    ends = tuple(each.low for _, each in mine), tuple(each.high for _, each in mine)
    values, places = tuple(each.value for _, each in mine), tuple(place for place, _ in mine)
    return Series(agent.split()[0], agent, values, places, x_band=ends, form="points")
