"""Evaluation curves with 95 % bands, a panel per target and kind of source (Figure 2)."""

from __future__ import annotations

from collections.abc import Collection, Mapping

import pandas as pd

from dashboards.figure_model import Absent, Chart, Panel, Series
from dashboards.labels import by_source, count, heading, in_order, label, targets
from orchestrator.analysis.curves.bands import curve_bands
from orchestrator.analysis.findings import Findings
from orchestrator.analysis.groups import Group

NAME, TITLE = "curves", "Evaluation curves"

MAX_OTHERS = 2
"""Configurations of an agent drawn in addition to its best."""

MAX_POINTS = 160
"""Points drawn of a curve, evenly spaced, first and last included; the tables have them all."""

Bands = Mapping[tuple[str, str], pd.DataFrame]


def chart(findings: Findings) -> Chart | Absent:
    """Return the figure: each agent's best configuration on each target, and up to MAX_OTHERS more in thin lines."""
    best = findings.best
    shown = [target for target in targets(findings) if any(group.task == target for group in best)]
    if not shown:
        return Absent(
            NAME, TITLE, "No configuration on a target task has every seed done, so there is no curve to draw."
        )
    drawn = {group.id: group for group in best if group.task in shown}
    others = {group.id: group for target in shown for group in _others(findings, target)}
    bands = curve_bands(findings.points, findings.cells, [*drawn, *others], ["greedy_return"])
    lines = {key: line(g, bands[key, "greedy_return"], findings.common) for key, g in drawn.items()}
    lines |= {key: line(g, bands[key, "greedy_return"], findings.common, faint=True) for key, g in others.items()}
    every_group = in_order([*others.values(), *drawn.values()])
    panels, columns = [], 1
    for target in shown:
        here = [group for group in every_group if group.task == target]
        sources = by_source(here)
        columns = max(columns, len(sources))
        panels += [_panel(target, source, tuple(lines[group.id] for group in of)) for source, of in sources]
    longest = max(len(band) for band in bands.values())
    every = -(-(longest - 1) // (MAX_POINTS - 1)) if longest > MAX_POINTS else 1
    caption = "Greedy return over training: mean and 95 % interval over seeds, of each agent's best configuration. "
    caption += f"Thin lines: others, of agents with at most {MAX_OTHERS} more. " if others else ""
    caption += (
        f"Of {longest} evaluations about every {every}th is drawn." if every > 1 else "Every evaluation is drawn."
    )
    alt = f"Evaluation curves of {count(len(drawn), 'configuration')} on {count(len(shown), 'target')}."
    return Chart(NAME, TITLE, caption, alt, tuple(panels), columns)


def _others(findings: Findings, target: str) -> list[Group]:
    """Return the configurations other than the best, of agents with at most MAX_OTHERS for one kind of source."""
    best = {group.id for group in findings.best}
    others = [g for g in findings.groups if g.task == target and g.complete and g.id not in best]
    return [g for g in others if sum((o.agent, o.source) == (g.agent, g.source) for o in others) <= MAX_OTHERS]


def _panel(target: str, source: str, series: tuple[Series, ...]) -> Panel:
    means = [value for one in series for value in one.y if value is not None]
    margin = 0.06 * (max(means) - min(means) or 1.0)
    reach = (min(means) - margin, max(means) + margin)
    return Panel(heading(target, source), "training episode", "greedy return", series, target, y_range=reach)


def line(group: Group, band: pd.DataFrame, hide: Collection[str] = (), faint: bool = False) -> Series:
    """Return a configuration's mean curve with its band, at most MAX_POINTS points; its label leaves out `hide`."""
    thin = thinned(band)
    low, high = (tuple(float(value) for value in thin[end]) for end in ("low", "high"))
    x, y = (tuple(float(value) for value in thin[name]) for name in ("episode", "mean"))
    return Series(group.agent, label(group, hide), x, y, (low, high) if len(group.seeds) > 1 else None, faint=faint)


def thinned(band: pd.DataFrame) -> pd.DataFrame:
    """Return at most MAX_POINTS rows, evenly spaced, first and last included."""
    if len(band) <= MAX_POINTS:
        return band
    last = len(band) - 1
    return band.iloc[[round(i * last / (MAX_POINTS - 1)) for i in range(MAX_POINTS)]]
