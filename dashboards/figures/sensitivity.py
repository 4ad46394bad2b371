"""Sensitivity: AUC against each hyperparameter that the sweep varied."""

from __future__ import annotations

import json
from collections.abc import Sequence
from typing import Any, Literal

from dashboards.figure_model import Absent, Chart, Panel, Series
from dashboards.labels import SOURCES, in_order, targets
from orchestrator.analysis.findings import Findings
from orchestrator.analysis.groups import Group
from orchestrator.planning.arms import Key

NAME, TITLE = "sensitivity", "Sensitivity to each hyperparameter"

LOG_FROM = 20
"""Ratio of the largest to the least value from which the axis is logarithmic."""

MAX_NAMED = 8
"""Values of a hyperparameter that are evenly spaced on the axis; with more, numbers are drawn to scale."""


def members(findings: Findings) -> dict[Key, list[Group]]:
    """Return the complete configurations of each arm that has more than one."""
    found: dict[Key, list[Group]] = {}
    for group in in_order(group for group in findings.groups if group.complete and group.auc):
        found.setdefault(group.key, []).append(group)
    return {key: groups for key, groups in found.items() if len(groups) > 1}


def varied_names(groups: Sequence[Group]) -> list[str]:
    """Return the hyperparameters in which configurations differ."""
    names = groups[0].hyperparameters
    return [name for name in names if len({_text(group.hyperparameters.get(name)) for group in groups}) > 1]


def chart(findings: Findings) -> Chart | Absent:
    """Return the figure: a panel per task and varied hyperparameter, with the best mean AUC at each value."""
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


def _panel(task: str, name: str, found: dict[Key, list[Group]]) -> Panel:
    mine = {key: groups for key, groups in found.items() if name in varied_names(groups)}
    values = sorted({_value(group, name) for groups in mine.values() for group in groups}, key=_order)
    to_scale = len(values) > MAX_NAMED and all(isinstance(value, int | float) for value in values)
    places = {value: float(value) if to_scale else float(place) for place, value in enumerate(values)}
    series = tuple(
        _series(key, groups, name, places, "points" if to_scale else "linked") for key, groups in mine.items()
    )
    log = to_scale and values[0] > 0 and values[-1] / values[0] > LOG_FROM
    ticks = () if to_scale else tuple(_text(value) for value in values)
    return Panel(task, name, "AUC", series, task, x_ticks=ticks, x_log=log)


def _series(
    key: Key, groups: Sequence[Group], name: str, places: dict[Any, float], form: Literal["points", "linked"]
) -> Series:
    """Return the best of an agent's configurations at each value of one hyperparameter."""
    agent, source = key.agent, key.kind
    best = [(place, max(_with(groups, name, value), key=_auc, default=None)) for value, place in places.items()]
    shown = [(place, group.auc) for place, group in best if group and group.auc]
    x, y = tuple(place for place, _ in shown), tuple(auc.value for _, auc in shown)
    low = tuple(auc.value if auc.low is None else auc.low for _, auc in shown)
    high = tuple(auc.value if auc.high is None else auc.high for _, auc in shown)
    label = agent if source == "none" else f"{agent}, {SOURCES[source]}"
    label += groups[0].source_label.removeprefix(source)
    return Series(agent, label, x, y, (low, high), form=form, hollow=source == "exact")


def _with(groups: Sequence[Group], name: str, value: Any) -> list[Group]:
    return [group for group in groups if _value(group, name) == value]


def _auc(group: Group) -> float:
    return group.auc.value if group.auc else float("-inf")


def _value(group: Group, name: str) -> Any:
    return group.hyperparameters.get(name)


def _order(value: Any) -> tuple[bool, float, str]:
    """Return a sort key: numbers by size, then text."""
    number = isinstance(value, int | float)
    return not number, float(value) if number else 0.0, str(value)


def _text(value: Any) -> str:
    return (
        f"{value:g}" if isinstance(value, float) else str(value) if isinstance(value, int | str) else json.dumps(value)
    )
