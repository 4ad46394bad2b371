"""The names of tasks, agents, sources and numbers in figures."""

from __future__ import annotations

import re
from collections.abc import Collection, Iterable, Sequence

from dashboards.style import rank
from orchestrator.analysis.findings import Findings
from orchestrator.analysis.groups import Group
from orchestrator.analysis.labels import settings as to_show
from orchestrator.analysis.labels import settings_text
from trainables.plugins.names import short

SOURCES = {"learned": "learned source", "exact": "exact source"}


def targets(findings: Findings) -> list[str]:
    """Return the target tasks in the order of the search space, under their names in the tables."""
    from trainables.tasks.registry import parse_task

    asked = [parse_task(target).name for scenario in findings.results.space().scenarios for target in scenario.targets]
    there = {group.task for group in findings.groups}
    return [target for target in dict.fromkeys(asked) if target in there]


def settings(group: Group, hide: Collection[str] = ()) -> str:
    """Return a group's tuned hyperparameters and those that are no defaults, without those in `hide`, as text."""
    shown = {name: value for name, value in to_show(group).items() if name not in hide}
    return settings_text(shown) if shown else ""


def label(group: Group, hide: Collection[str] = ()) -> str:
    """Return 'agent (settings)', without the settings in `hide`; with its source where it has several on the task."""
    text = settings(group, hide)
    name = f"{short(group.agent)} ({text})" if text else short(group.agent)
    return name + group.source_label.removeprefix(group.source)


def heading(target: str, source: str) -> str:
    """Return 'target, learned source', with the name of the source where `source` is a label that has it."""
    kind = next((kind for kind in SOURCES if source.startswith(kind)), None)
    return f"{short(target)}, {SOURCES[kind]}{source.removeprefix(kind)}" if kind else short(target)


def in_order(groups: Iterable[Group]) -> list[Group]:
    """Return groups in the order of the legends, learned sources before exact ones; the sort is stable."""
    return sorted(groups, key=lambda group: (rank(group.agent), group.source != "learned"))


def kinds(groups: Iterable[Group]) -> list[str]:
    """Return the kinds of source among groups, learned first; ['none'] where there is no transfer."""
    there = {group.source for group in groups}
    return [kind for kind in SOURCES if kind in there] or ["none"]


def by_source(groups: Iterable[Group]) -> list[tuple[str, list[Group]]]:
    """Return (label of the source, groups) for each source of a target's groups, with its baselines; learned first."""
    groups = list(groups)
    first = {group.source_label: group for group in reversed(groups) if group.source != "none"}
    order = list(SOURCES)
    labels = sorted(
        dict.fromkeys(group.source_label for group in groups if group.source_label in first),
        key=lambda label: order.index(first[label].source),
    )

    def of(label: str, group: Group) -> bool:
        if group.source == "none":
            return group.source_task in (None, first[label].source_task)
        return group.source_label == label

    return [(label, [group for group in groups if of(label, group)]) for label in labels] or [("none", groups)]


def minus(text: str) -> str:
    """Return `text` with a minus sign for the hyphen before a number, but not for that in a name or in 1e-05."""
    return re.sub(r"(?<!\w)-(?=[\d.])", "−", text)


def listed(names: Sequence[str]) -> str:
    """Return names as text: 'a, b and c'."""
    return names[0] if len(names) == 1 else ", ".join(names[:-1]) + f" and {names[-1]}" if names else ""


def count(number: int, noun: str) -> str:
    """Return a number with its noun: '1 cell', '2 cells'."""
    return f"{number} {noun}" if number == 1 else f"{number} {noun}s"
