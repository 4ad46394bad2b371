"""AUC against the share of training with advice (Figure 4): a group of bars per share, sd over seeds as error bars."""

from __future__ import annotations

from collections.abc import Sequence

from dashboards.figure_model import Absent, Chart, Level, Panel, Series
from dashboards.labels import by_source, heading, in_order, targets
from orchestrator.analysis.findings import Findings
from orchestrator.analysis.groups import Group

NAME, TITLE = "advice_fraction", "How long advice should last"
SHARE = "advice_fraction"


def chart(findings: Findings) -> Chart | Absent:
    """Return the figure: a panel per target and kind of source with more than one share."""
    advised = [group for group in findings.groups if SHARE in group.hyperparameters and group.complete]
    panels = []
    for target in targets(findings):
        best = [group for group in findings.best if group.task == target]
        bases = [group for group in best if group.source == "none"]
        for source, here in by_source([*bases, *(group for group in advised if group.task == target)]):
            tried = [group for group in here if group.source != "none"]
            if len(_shares(tried)) > 1:
                panels.append(_panel(target, source, tried, [group for group in bases if group in here]))
    if not panels:
        return Absent(NAME, TITLE, "No agent was given two advice fractions on a target, with every seed done.")
    caption = "AUC, mean and sd over seeds, against the share of the source run's steps with advice. "
    caption += "Dashed: the agent without transfer. Of several configurations with one share, the best is shown."
    alt = f"Bars of AUC by advice fraction on {len(panels)} targets."
    return Chart(NAME, TITLE, caption, alt, tuple(panels))


def _shares(groups: Sequence[Group]) -> list[float]:
    return sorted({float(group.hyperparameters[SHARE]) for group in groups})


def _panel(target: str, source: str, advised: Sequence[Group], bases: Sequence[Group]) -> Panel:
    shares = _shares(advised)
    agents = list(dict.fromkeys(group.agent for group in in_order(advised)))
    series = []
    for agent in agents:
        chosen = [_best_at([group for group in advised if group.agent == agent], share) for share in shares]
        means = tuple(group.auc.value if group and group.auc else None for group in chosen)
        sds = tuple((group.auc.sd or 0.0) if group and group.auc else 0.0 for group in chosen)
        low = tuple(None if mean is None else mean - sd for mean, sd in zip(means, sds, strict=True))
        high = tuple(None if mean is None else mean + sd for mean, sd in zip(means, sds, strict=True))
        series.append(Series(agent, agent, tuple(map(float, range(len(shares)))), means, (low, high), form="bars"))
    base = [Level(group.auc.value, group.agent, group.agent) for group in bases if group.auc]
    ticks = tuple(f"{share:.0%}" for share in shares)
    x_title = "share of the source run's steps with advice"
    return Panel(heading(target, source), x_title, "AUC", tuple(series), target, tuple(base), ticks)


def _best_at(groups: Sequence[Group], share: float) -> Group | None:
    tried = [group for group in groups if float(group.hyperparameters[SHARE]) == share and group.auc]
    return max(tried, key=lambda group: group.auc.value if group.auc else 0.0, default=None)
