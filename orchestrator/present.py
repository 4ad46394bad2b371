"""Tables for a terminal."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, Any

import rich.box
from rich.table import Table
from rich.text import Text

if TYPE_CHECKING:
    from orchestrator.aggregates import Group
    from trainables.agents import Agent
    from trainables.tasks import TaskFamily, Value

COLOURS = {"helped": "green", "hurt": "red"}
"""A verdict's colour in a terminal."""


def table(columns: Sequence[str], rows: Iterable[Sequence[str | Text]], title: str | None = None) -> Table:
    """A plain table; the cells of the first column are never cut."""
    result = Table(title=title, box=rich.box.SIMPLE_HEAD, title_justify="left", pad_edge=False)
    for number, column in enumerate(columns):
        result.add_column(column, overflow="fold", no_wrap=number == 0)
    for cells in rows:
        result.add_row(*(Text(cell) if isinstance(cell, str) else cell for cell in cells))
    return result


def duration(seconds: float) -> str:
    """'40 ms', '3 s', '12 min', '5.2 h'."""
    if seconds < 1:
        return f"{1000 * seconds:.0f} ms"
    if seconds < 100:
        return f"{seconds:.0f} s"
    return f"{seconds / 60:.0f} min" if seconds < 6000 else f"{seconds / 3600:.1f} h"


def span(low: float, high: float) -> str:
    """'3 to 12 min' of two numbers of seconds; one duration where they read the same."""
    first, last = duration(low), duration(high)
    if first == last:
        return last
    (number, unit), (_, other) = first.split(), last.split()
    return f"{number} to {last}" if unit == other else f"{number} {unit} to {last}"


def group_table(groups: Sequence[Group], title: str, tried: Mapping[str, int] | None = None) -> Table:
    """Groups under the columns of the results table, task by task; green where transfer helped, red where it hurt.

    tried: group id to the number of configurations that it is the best of.
    """
    from orchestrator.describe import COLUMNS, row, settings_text, shared

    lines: list[tuple[str | Text, ...]] = []
    last, common = "", shared(groups)
    for group in sorted(groups, key=lambda group: group.task):
        cells: list[str | Text] = list(row(group, common))
        of = (tried or {}).get(group.id, 1)
        cells[3] += f" (best of {of})" if of > 1 else ""
        cells[-2:] = [Text(str(cell), style=COLOURS.get(group.verdict or "", "")) for cell in cells[-2:]]
        lines.append(("" if group.task == last else cells[0], *cells[1:]))
        last = group.task
    return table(COLUMNS, lines, title + (f"; all with {settings_text(common)}" if common else ""))


def task_data(family: TaskFamily) -> dict[str, Any]:
    """A task family as plain data."""
    return {
        "name": family.name,
        "description": family.description,
        "tabular": family.model is not None,
        "features": [
            {
                "name": feature.name,
                "default": _json(feature.default),
                "description": feature.description,
                "named_values": {name: _json(value) for name, value in feature.named.items()},
            }
            for feature in family.features
        ],
        "paper_targets": list(family.targets),
        "paper_hyperparameters": dict(family.defaults),
    }


def agent_data(agent: Agent) -> dict[str, Any]:
    """An agent as plain data."""
    fields = agent.hyperparameters.model_fields
    return {
        "name": agent.name,
        "description": agent.description,
        "kind": agent.kind,
        "compared_with": agent.base,
        "hyperparameters": [
            {"name": name, "default": field.default, "description": field.description} for name, field in fields.items()
        ],
    }


def _json(value: Value) -> Any:
    return list(value) if isinstance(value, tuple) else value
