"""Agents over all tasks: interquartile means and probabilities of improvement, and performance profiles."""

from __future__ import annotations

import numpy as np

from dashboards.figure_model import Absent, Chart, Level, Panel, Series
from dashboards.labels import SOURCES, count, listed
from dashboards.style import rank
from orchestrator.analysis.findings import Findings
from orchestrator.analysis.inference.across_tasks import profile
from orchestrator.analysis.over_tasks import Entrant, OverTasks, Standing
from orchestrator.analysis.statistics import Estimate
from trainables.plugins.names import short

NAME, TITLE = "over_tasks", "Interquartile mean over all tasks"
PROFILE, PROFILE_TITLE = "performance_profile", "Performance profile"

THRESHOLDS = 61
"""Points of a performance profile."""

ENTRANTS = 16
"""Most lines of a performance profile: those with the best interquartile means."""


def chart(findings: Findings) -> Chart | Absent:
    """Return the interquartile mean of each agent, and the probability of improvement of each pair of interest."""
    found = findings.over_tasks
    if reason := lacking(found):
        return Absent(NAME, TITLE, reason)
    standings = sorted(found.standings, key=lambda standing: -standing.aggregates["iqm"].value)
    means = [(standing.entrant, standing.aggregates["iqm"]) for standing in standings]
    panels = [_points("Interquartile mean", "normalised AUC", [(name(one), one, value) for one, value in means], None)]
    chances = [(f"{name(one.first)} > {name(one.second)}", one.first, one.estimate) for one in found.improvements]
    if chances:
        panels.append(_points("P(a run of A beats one of B)", "probability", chances, 0.5))
    return Chart(NAME, TITLE, _caption(found), f"{TITLE}; the numbers are in the table.", tuple(panels))


def performance_profile(findings: Findings) -> Chart | Absent:
    """Return the share of runs above each normalised score, of each agent."""
    found = findings.over_tasks
    if reason := lacking(found):
        return Absent(PROFILE, PROFILE_TITLE, reason)
    best = sorted(found.standings, key=lambda standing: -standing.aggregates["iqm"].value)[:ENTRANTS]
    runs = np.concatenate([table.ravel() for standing in best for table in standing.scores])
    thresholds = np.linspace(min(float(runs.min()), 0.0), max(float(runs.max()), 1.0), THRESHOLDS)
    series = tuple(_profile(standing, thresholds) for standing in sorted(best, key=lambda one: rank(one.entrant.agent)))
    caption = (
        "The share of all runs with a normalised AUC above each value, with pointwise 95 % intervals by stratified "
    )
    caption += "bootstrap: a line above another is better there. 0 and 1 are the reference values of each task."
    panel = Panel(PROFILE_TITLE, "normalised AUC", "share of runs above", series, levels=(Level(1.0, upright=True),))
    return Chart(
        PROFILE, PROFILE_TITLE, caption, f"{PROFILE_TITLE} of {count(len(best), 'agent')}.", (panel,), columns=1
    )


def lacking(found: OverTasks) -> str:
    """Return why there is nothing to show over all tasks, in a sentence; empty where there is."""
    if not found.tasks:
        return (
            "The search space names no reference values for its targets: add normalise: {TASK: [random, solved]}, the "
            "returns that count as 0 and as 1."
        )
    return "" if found.standings else "No agent has every seed done on each of the tasks with reference values."


def name(entrant: Entrant) -> str:
    """Return 'delta_es', with the source where it is not the only one."""
    text = short(entrant.agent)
    if entrant.source in SOURCES and entrant.source != "learned":
        text += f", {entrant.source}"
    return text + (f", {short(entrant.source_task)}" if entrant.source_task else "")


def _points(title: str, x_title: str, rows: list[tuple[str, Entrant, Estimate]], level: float | None) -> Panel:
    agents = dict.fromkeys(entrant.agent for _, entrant, _ in rows)
    series = []
    for agent in agents:
        mine = [(float(at), label, value) for at, (label, one, value) in enumerate(rows) if one.agent == agent]
        values = [value for _, _, value in mine]
        lows = tuple(value.value if value.low is None else value.low for value in values)
        highs = tuple(value.value if value.high is None else value.high for value in values)
        x, y = tuple(value.value for value in values), tuple(at for at, _, _ in mine)
        hover = tuple(label for _, label, _ in mine)
        series.append(Series(agent, agent, x, y, x_band=(lows, highs), form="points", hover=hover))
    labels = tuple(label for label, _, _ in rows)
    ends = [end for one in series if one.x_band for side in one.x_band for end in side if end is not None]
    ends += [] if level is None else [level]
    margin = 0.08 * max(max(ends) - min(ends), 0.1)
    reach = min(ends) - margin, max(ends) + margin
    levels = () if level is None else (Level(level, upright=True),)
    return Panel(title, x_title, "", tuple(series), levels=levels, y_ticks=labels, x_range=reach)


def _profile(standing: Standing, thresholds: np.ndarray) -> Series:
    value, low, high = (tuple(map(float, line)) for line in profile(standing.scores, list(thresholds)))
    x = tuple(map(float, thresholds))
    return Series(standing.entrant.agent, name(standing.entrant), x, value, band=(low, high))


def _caption(found: OverTasks) -> str:
    text = f"Over {count(len(found.tasks), 'task')}, with 95 % intervals: by stratified bootstrap over seeds for the "
    text += "interquartile mean, by Newcombe's for each task put together for P(A beats B). 0 and 1 are the "
    text += "reference values of each task."
    if found.left_out:
        text += f" Left out, for want of a task: {listed([name(one) for one in found.left_out])}."
    return text
