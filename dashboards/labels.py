"""How the figures name things."""

from __future__ import annotations

import re
from collections.abc import Collection, Iterable, Sequence

from dashboards.style import rank
from orchestrator.analysis.findings import Findings
from orchestrator.analysis.groups import Group
from orchestrator.analysis.labels import settings_text, varied
from trainables.plugins.names import short

SOURCES = {"learned": "learned source", "exact": "exact source"}


def targets(findings: Findings) -> list[str]:
    """The target tasks in the order of the search space, under the names that the tables use."""
    from trainables.tasks.registry import parse_task

    asked = [parse_task(target).name for scenario in findings.results.space().scenarios for target in scenario.targets]
    there = {group.task for group in findings.groups}
    return [target for target in dict.fromkeys(asked) if target in there]


def settings(group: Group, hide: Collection[str] = ()) -> str:
    """A group's hyperparameters beside its agent's defaults, without those in `hide`; empty where there are none."""
    own = varied(group.agent, group.task, group.hyperparameters)
    shown = {name: value for name, value in own.items() if name not in hide}
    return settings_text(shown) if shown else ""


def label(group: Group, hide: Collection[str] = ()) -> str:
    """'agent (settings)', without the settings in `hide`, and its source where it has several on the task."""
    own = settings(group, hide)
    name = f"{short(group.agent)} ({own})" if own else short(group.agent)
    return name + group.source_label.removeprefix(group.source)


def heading(target: str, source: str) -> str:
    """'target, learned source'."""
    return f"{short(target)}, {SOURCES[source]}" if source in SOURCES else short(target)


def in_order(groups: Iterable[Group]) -> list[Group]:
    """Groups in the order of the legends, learned sources before exact ones, else as they are."""
    return sorted(groups, key=lambda group: (rank(group.agent), group.source != "learned"))


def kinds(groups: Iterable[Group]) -> list[str]:
    """The kinds of source among groups, learned first; ['none'] where there is no transfer."""
    there = {group.source for group in groups}
    return [kind for kind in SOURCES if kind in there] or ["none"]


def minus(text: str) -> str:
    """The hyphen before a number, not the one in a name or in 1e-05, becomes a minus sign."""
    return re.sub(r"(?<!\w)-(?=[\d.])", "−", text)


def listed(names: Sequence[str]) -> str:
    """'a, b and c'."""
    return names[0] if len(names) == 1 else ", ".join(names[:-1]) + f" and {names[-1]}" if names else ""


def count(number: int, noun: str) -> str:
    """'1 cell', '2 cells'."""
    return f"{number} {noun}" if number == 1 else f"{number} {noun}s"
