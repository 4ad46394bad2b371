"""Evaluation curves with 95 % bands, one row per target task, learned and exact source side by side (Figure 2)."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import pandas as pd
from matplotlib.axes import Axes

from dashboards.style import COLOURS, LINES, new_figure, save
from orchestrator.aggregates import Group, groups, mean_curve
from orchestrator.describe import settings_text, varied
from orchestrator.results import Results
from orchestrator.selection import select
from trainables.plugins.names import short
from trainables.tasks import parse_task

OTHERS = 2
"""Most configurations of an agent that are drawn beside its best."""

SOURCES = {"learned": "learned source", "exact": "exact source"}


def draw(results: Results) -> list[Path]:
    """Draw the best configuration of each agent on each target, and up to OTHERS more of it in thin lines.

    No file where no target is complete.
    """
    cells, points = results.tables()
    if cells.empty:
        return []
    every = groups(cells)
    best = [selected.best for selected in select(every, cells).values()]
    targets = [parse_task(target).name for scenario in results.space().scenarios for target in scenario.targets]
    rows = [target for target in dict.fromkeys(targets) if any(group.task == target for group in best)]
    columns = [source for source in SOURCES if any(group.source == source for group in best)] or ["none"]
    if not rows:
        return []
    figure = new_figure(4.6 * len(columns) + 0.6, 3.2 * len(rows) + 0.5)
    axes = figure.subplots(len(rows), len(columns), squeeze=False, sharey="row")
    for i, target in enumerate(rows):
        for j, source in enumerate(columns):
            here = [group for group in every if group.task == target and group.source in (source, "none")]
            _panel(axes[i, j], [group for group in here if group in best], _others(here, best), cells, points)
            axes[i, j].set_title(f"{short(target)}\n{SOURCES.get(source, '')}".strip(), fontsize=9)
            axes[i, j].set_xlabel("training episode", labelpad=1)
        axes[i, 0].set_ylabel("greedy return")
    seeds = sorted({len(group.seeds) for group in best})
    text = f"{seeds[0]}" if len(seeds) == 1 else f"{seeds[0]} to {seeds[-1]}"
    figure.suptitle(f"{results.name}: greedy evaluation, mean and 95 % interval over {text} seeds", fontsize=10)
    return save(figure, results.folder / "figures", "curves")


def _others(here: Sequence[Group], best: Sequence[Group]) -> list[Group]:
    """The configurations beside the best, of agents that have few of them."""
    others = [group for group in here if group.complete and group not in best]
    return [group for group in others if sum(other.agent == group.agent for other in others) <= OTHERS]


def _panel(
    axes: Axes, best: Sequence[Group], others: Sequence[Group], cells: pd.DataFrame, points: pd.DataFrame
) -> None:
    spans: list[float] = []
    for group in sorted(
        [*best, *others], key=lambda group: list(COLOURS).index(group.agent) if group.agent in COLOURS else 99
    ):
        curve = mean_curve(points, cells, group.id)
        own = settings_text(varied(group.agent, group.task, group.hyperparameters))
        label = short(group.agent) + ("" if own == "-" else f" ({own})")
        colour: Any = COLOURS.get(group.agent)
        line: Any = LINES.get(group.agent, "-")
        width, band = (1.3, 0.18) if group in best else (0.7, 0.08)
        axes.plot(curve["episode"], curve["mean"], ls=line, color=colour, label=label, lw=width)
        axes.fill_between(curve["episode"], curve["low"], curve["high"], color=colour, alpha=band, lw=0)
        spans += [curve["mean"].min(), curve["mean"].max()]
    if spans:
        margin = 0.06 * (max(spans) - min(spans) or 1.0)
        axes.set_ylim(min(spans) - margin, max(spans) + margin)
    axes.legend(fontsize=7, ncols=2, loc="upper center", bbox_to_anchor=(0.5, -0.16))
