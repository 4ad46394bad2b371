"""Hyperparameter importance (fANOVA) of every agent whose hyperparameters were searched in ranges."""

from __future__ import annotations

from dashboards.figure_model import Absent, Chart, Panel, Series
from dashboards.labels import SOURCES, heading, targets
from dashboards.style import rank
from orchestrator.analysis.findings import Findings
from orchestrator.analysis.importance import MIN_CONFIGURATIONS, Importance, importances

NAME, TITLE = "importance", "Importance of each hyperparameter"


def chart(findings: Findings) -> Chart | Absent:
    """Return the figure: a panel per task and source, with a group of bars per hyperparameter."""
    found = importances(findings)
    if not found:
        reason = (
            f"No agent with ranges of hyperparameters has {MIN_CONFIGURATIONS} configurations with every seed done."
        )
        return Absent(NAME, TITLE, reason)
    first = {target: place for place, target in enumerate(targets(findings))}
    order = list(SOURCES)
    places = sorted(
        {(one.key.task, one.source_label, one.key.kind) for one in found},
        key=lambda place: (first.get(place[0], -1), order.index(place[2]) if place[2] in order else -1),
    )
    panels = [
        _panel(task, label, [one for one in found if (one.key.task, one.source_label) == (task, label)])
        for task, label, _ in places
    ]
    fewest = min(one.configurations for one in found)
    caption = "Share of the variance of the mean AUC, over the ranges that were searched, that each hyperparameter "
    caption += f"explains (fANOVA: a random forest over at least {fewest} configurations of each agent). "
    caption += "It says what to tune, not to what value; the plots below have the values."
    alt = f"Importance of hyperparameters in {len(panels)} panels."
    return Chart(NAME, TITLE, caption, alt, tuple(panels))


def _panel(task: str, label: str, found: list[Importance]) -> Panel:
    found = sorted(found, key=lambda one: rank(one.key.agent))
    total = {name: max(one.shares.get(name, 0.0) for one in found) for one in found for name in one.shares}
    names = sorted(total, key=lambda name: -total[name])
    series = tuple(
        Series(
            one.key.agent,
            one.key.agent,
            tuple(float(place) for place, name in enumerate(names) if name in one.shares),
            tuple(100 * one.shares[name] for name in names if name in one.shares),
            form="bars",
        )
        for one in found
    )
    return Panel(heading(task, label), "", "importance (%)", series, task, x_ticks=tuple(names), y_range=(0.0, 100.0))
