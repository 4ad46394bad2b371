"""AUC against the share of training with advice (Figure 4): a group of bars per share, sd over seeds as error bars."""

from __future__ import annotations

from pathlib import Path

from matplotlib.axes import Axes

from dashboards.style import COLOURS, new_figure, save
from orchestrator.aggregates import Group, groups
from orchestrator.results import Results

NAME = "advice_fraction"


def draw(results: Results) -> list[Path]:
    """Draw a panel per target on which more than one share was tried; no file where there is none."""
    cells, _ = results.tables()
    advised = [group for group in groups(cells) if NAME in group.hyperparameters and group.complete]
    targets = [task for task in dict.fromkeys(group.task for group in advised) if len(_shares(advised, task)) > 1]
    if not targets:
        return []
    figure = new_figure(4.4 * len(targets) + 0.4, 3.6)
    panels = figure.subplots(1, len(targets), squeeze=False)[0]
    for axes, target in zip(panels, targets, strict=True):
        base = [group for group in groups(cells) if group.task == target and group.source == "none" and group.complete]
        _panel(axes, [group for group in advised if group.task == target], base, _shares(advised, target))
        axes.set_title(target, fontsize=9)
        axes.set_xlabel("share of the source run's steps with advice", labelpad=1)
    panels[0].set_ylabel("AUC, mean and sd over seeds")
    figure.suptitle(f"{results.name}: how long should advice last?", fontsize=10)
    return save(figure, results.folder / "figures", "advice_fraction")


def _shares(advised: list[Group], task: str) -> list[float]:
    return sorted({float(group.hyperparameters[NAME]) for group in advised if group.task == task})


def _panel(axes: Axes, advised: list[Group], base: list[Group], shares: list[float]) -> None:
    agents = list(dict.fromkeys(group.agent for group in advised))
    width = 0.8 / len(agents)
    for number, agent in enumerate(agents):
        mine = {float(group.hyperparameters[NAME]): group for group in advised if group.agent == agent}
        at = [shares.index(share) + (number - (len(agents) - 1) / 2) * width for share in mine]
        means = [group.auc.value for group in mine.values() if group.auc]
        deviations = [group.auc_sd or 0.0 for group in mine.values()]
        axes.bar(at, means, width * 0.92, yerr=deviations, capsize=3, color=COLOURS[agent], label=agent)
    for group in base[:1]:
        if group.auc:
            axes.axhline(group.auc.value, color=COLOURS[group.agent], ls="--", lw=1.2, label=group.agent)
    axes.set_xticks(range(len(shares)), [f"{share:.0%}" for share in shares])
    axes.legend(fontsize=7, ncols=3, loc="upper center", bbox_to_anchor=(0.5, -0.16))
