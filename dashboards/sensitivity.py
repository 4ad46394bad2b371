"""What each hyperparameter does: AUC against every one that the sweep varied, and all of them at once."""

from __future__ import annotations

import json
from collections.abc import Sequence
from typing import Any, Literal

from dashboards.charts import Absent, Axis, Chart, Panel, Parallel, Series
from dashboards.style import rank
from dashboards.words import SOURCES, count, in_order, targets
from orchestrator.aggregates import Group
from orchestrator.findings import Findings

NAME, TITLE = "sensitivity", "Sensitivity to each hyperparameter"
PARALLEL, PARALLEL_TITLE = "parallel", "All hyperparameters at once"

LINES = 200
"""Most configurations of one parallel-coordinates panel: the best ones."""

NAMED = 8
"""Most values of a hyperparameter that stand evenly spaced under their names; more numbers are drawn to scale."""

Member = tuple[str, str, str]
"""(task, agent, source)."""


def members(findings: Findings) -> dict[Member, list[Group]]:
    """The complete configurations of each (task, agent, source) that has more than one."""
    found: dict[Member, list[Group]] = {}
    for group in in_order(group for group in findings.groups if group.complete and group.auc):
        found.setdefault((group.task, group.agent, group.source), []).append(group)
    return {key: groups for key, groups in found.items() if len(groups) > 1}


def varied_names(groups: Sequence[Group]) -> list[str]:
    """The hyperparameters in which configurations differ."""
    names = groups[0].hyperparameters
    return [name for name in names if len({_text(group.hyperparameters.get(name)) for group in groups}) > 1]


def chart(findings: Findings) -> Chart | Absent:
    """A panel per task and varied hyperparameter: the best mean AUC at each of its values."""
    found = members(findings)
    first = {target: place for place, target in enumerate(targets(findings))}
    keys = sorted(found, key=lambda key: first.get(key[0], len(first)))
    wanted = dict.fromkeys((key[0], name) for key in keys for name in varied_names(found[key]))
    if not wanted:
        return Absent(NAME, TITLE, "No agent has two configurations with every seed done, so nothing was varied.")
    panels = [_panel(task, name, {k: g for k, g in found.items() if k[0] == task}) for task, name in wanted]
    caption = (
        "AUC, mean and 95 % interval over seeds, at each value that was tried; of several configurations with one "
    )
    caption += "value, the best. A steep line is a hyperparameter that must be tuned."
    alt = f"AUC against hyperparameters: {', '.join(dict.fromkeys(name for _, name in wanted))}."
    return Chart(NAME, TITLE, caption, alt, tuple(panels), columns=3)


def _panel(task: str, name: str, found: dict[Member, list[Group]]) -> Panel:
    mine = {key: groups for key, groups in found.items() if name in varied_names(groups)}
    values = sorted({_value(group, name) for groups in mine.values() for group in groups}, key=_order)
    to_scale = len(values) > NAMED and all(isinstance(value, int | float) for value in values)
    places = {value: float(value) if to_scale else float(place) for place, value in enumerate(values)}
    series = tuple(
        _series(key, groups, name, places, "points" if to_scale else "linked") for key, groups in mine.items()
    )
    log = to_scale and values[0] > 0 and values[-1] / values[0] > 50
    ticks = () if to_scale else tuple(_text(value) for value in values)
    return Panel(task, name, "AUC", series, task, x_ticks=ticks, x_log=log)


def _series(
    key: Member, groups: Sequence[Group], name: str, places: dict[Any, float], form: Literal["points", "linked"]
) -> Series:
    """The best of an agent's configurations at each value of one hyperparameter."""
    _, agent, source = key
    best = [(place, max(_with(groups, name, value), key=_auc, default=None)) for value, place in places.items()]
    shown = [(place, group.auc) for place, group in best if group and group.auc]
    x, y = tuple(place for place, _ in shown), tuple(auc.value for _, auc in shown)
    low = tuple(auc.value if auc.low is None else auc.low for _, auc in shown)
    high = tuple(auc.value if auc.high is None else auc.high for _, auc in shown)
    label = agent if source == "none" else f"{agent}, {SOURCES[source]}"
    return Series(agent, label, x, y, (low, high), form=form, hollow=source == "exact")


def _with(groups: Sequence[Group], name: str, value: Any) -> list[Group]:
    return [group for group in groups if _value(group, name) == value]


def _auc(group: Group) -> float:
    return group.auc.value if group.auc else float("-inf")


def _value(group: Group, name: str) -> Any:
    return group.hyperparameters.get(name)


def _order(value: Any) -> tuple[bool, float, str]:
    """Numbers by size, then words."""
    number = isinstance(value, int | float)
    return not number, float(value) if number else 0.0, str(value)


def _text(value: Any) -> str:
    return (
        f"{value:g}" if isinstance(value, float) else str(value) if isinstance(value, int | str) else json.dumps(value)
    )


def parallel(findings: Findings) -> Parallel | Absent:
    """A panel per (task, agent) in which two hyperparameters or more were varied; learned and exact are an axis."""
    merged: dict[tuple[str, str], list[Group]] = {}
    for (task, agent, _), groups in members(findings).items():
        merged.setdefault((task, agent), []).extend(groups)
    panels = []
    first = {target: place for place, target in enumerate(targets(findings))}
    for (task, agent), groups in sorted(merged.items(), key=lambda item: (first.get(item[0][0], 99), rank(item[0][1]))):
        names = varied_names(groups)
        kinds = sorted({group.source for group in groups})
        if len(names) + (len(kinds) > 1) > 1:
            best = sorted(groups, key=_auc, reverse=True)[:LINES]
            panels.append((task, agent, _axes(best, names, kinds)))
    if not panels:
        reason = "No agent was swept over two things at once, so there are no coordinates to set side by side."
        return Absent(PARALLEL, PARALLEL_TITLE, reason)
    caption = (
        "A line per configuration, from its hyperparameters to its mean AUC on the last axis; the stronger, the better."
    )
    alt = f"Parallel coordinates in {count(len(panels), 'panel')}."
    return Parallel(PARALLEL, PARALLEL_TITLE, caption, alt, tuple(panels))


def _axes(groups: Sequence[Group], names: Sequence[str], kinds: Sequence[str]) -> tuple[Axis, ...]:
    axes = [_axis(name, [_value(group, name) for group in groups]) for name in names]
    if len(kinds) > 1:
        axes.append(_axis("source", [group.source for group in groups]))
    return (*axes, Axis("AUC", tuple(_auc(group) for group in groups)))


def _axis(name: str, values: Sequence[Any]) -> Axis:
    """Few values or words: evenly spaced and named; many numbers: to scale."""
    different = sorted(set(values), key=_order)
    if len(different) > NAMED and all(isinstance(value, int | float) for value in different):
        return Axis(name, tuple(map(float, values)))
    return Axis(name, tuple(float(different.index(value)) for value in values), tuple(map(_text, different)))
