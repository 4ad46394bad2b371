"""Gate or advice over training: how often the source is followed, and how delta develops."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Sequence

from dashboards.figure_model import Absent, Chart, Level, Panel
from dashboards.figures.evaluation_curves import Bands, line
from dashboards.labels import by_source, count, heading, in_order, listed, targets
from orchestrator.analysis.curves.bands import curve_bands
from orchestrator.analysis.findings import Findings
from orchestrator.analysis.groups import Group
from trainables.agents.plots import Plot
from trainables.agents.registry import AGENTS, agent_named

NAME, TITLE = "gate", "Gate and advice over training"


def plots(groups: Iterable[Group]) -> list[Plot]:
    """Return the quantities to draw over training: those of the built-in agents, then of custom ones, each once."""
    custom = [agent_named(name) for name in dict.fromkeys(group.agent for group in groups)]
    return list(dict.fromkeys(plot for agent in (*AGENTS.values(), *custom) for plot in agent.plots))


def chart(findings: Findings) -> Chart | Absent:
    """Return the figure: a panel per target, kind of source and quantity, with each agent's best configuration."""
    shown = in_order(group for group in findings.best if group.source != "none")
    quantities = plots(shown)
    columns = [*(plot.statistic for plot in quantities), *(plot.level for plot in quantities if plot.level)]
    bands = curve_bands(findings.points, findings.cells, [group.id for group in shown], columns)
    panels = [
        panel
        for target in targets(findings)
        for source, here in by_source(group for group in shown if group.task == target)
        for plot in quantities
        if (panel := _panel(target, source, plot, here, bands, findings.common)) is not None
    ]
    if not panels:
        reason = "No agent with a source has every seed done, so there is no gate and no advice to show."
        return Absent(NAME, TITLE, reason)
    caption = (
        "Mean and 95 % interval over seeds, each agent's best configuration. Level lines: the threshold of the gate."
    )
    alt = f"{count(len(panels), 'panel')} of gate, advice and delta over training."
    return Chart(NAME, TITLE, caption, alt, tuple(panels), columns=3)


def _panel(
    target: str,
    source: str,
    plot: Plot,
    shown: Sequence[Group],
    bands: Bands,
    hide: Collection[str],
) -> Panel | None:
    here = [group for group in shown if len(bands[group.id, plot.statistic])]
    if not here:
        return None
    series = tuple(line(group, bands[group.id, plot.statistic], hide) for group in here)
    levels = _levels(plot.level, [group for group in here if plot.level in group.hyperparameters], bands)
    reach = (-0.04, 1.04) if plot.share else None
    title = f"{heading(target, source)}: {plot.title}"
    return Panel(title, "training episode", plot.axis, series, target, tuple(levels), y_range=reach)


def _levels(name: str, groups: Sequence[Group], bands: Bands) -> list[Level]:
    """Return one line per value of the hyperparameter `name`, named after the agents that have this value."""
    by_value: dict[float, list[str]] = {}
    for group in groups:
        value = _value(name, group, bands)
        if value is not None:
            by_value.setdefault(value, []).append(group.agent)
    return [Level(value, f"{name} of {listed(names)}", names[0]) for value, names in by_value.items()]


def _value(name: str, group: Group, bands: Bands) -> float | None:
    """Return a hyperparameter as a number; for text such as `auto`, the mean over seeds of the value that was used."""
    value = group.hyperparameters[name]
    if isinstance(value, int | float):
        return float(value)
    band = bands[group.id, name]
    return float(band["mean"].iloc[-1]) if len(band) else None
