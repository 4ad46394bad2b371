"""Tables for a terminal."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

from rich.text import Text

from deltatune.cli.sheet import Sheet, table

if TYPE_CHECKING:
    from orchestrator.analysis.groups import Group

__all__ = ["COLOURS", "duration", "group_table", "span", "table"]

COLOURS = {"helped": "green", "hurt": "red"}
"""A verdict's colour in a terminal."""


def duration(seconds: float) -> str:
    """Return seconds as text: '40 ms', '3 s', '12 min', '5.2 h'."""
    if seconds < 1:
        return f"{1000 * seconds:.0f} ms"
    if seconds < 100:
        return f"{seconds:.0f} s"
    return f"{seconds / 60:.0f} min" if seconds < 6000 else f"{seconds / 3600:.1f} h"


def span(low: float, high: float) -> str:
    """Return two numbers of seconds as '3 to 12 min'; as one duration where both read the same."""
    first, last = duration(low), duration(high)
    if first == last:
        return last
    (number, unit), (_, other) = first.split(), last.split()
    return f"{number} to {last}" if unit == other else f"{number} {unit} to {last}"


def group_table(groups: Sequence[Group], title: str, tried: Mapping[str, int] | None = None) -> Sheet:
    """Return configurations as rows of the results table by task; green where transfer helped, red where it hurt.

    tried: group id to the number of configurations of which it is the best.
    """
    from orchestrator.analysis.labels import settings_text, shared
    from orchestrator.analysis.metrics import shown
    from orchestrator.analysis.summary_table import COLUMNS, row

    lines: list[tuple[str | Text, ...]] = []
    last, common = "", shared(groups)
    compared = [COLUMNS.index(metric.heading) for metric in shown("summary") if metric.compared]
    for group in sorted(groups, key=lambda group: group.task):
        cells: list[str | Text] = list(row(group, common))
        of = (tried or {}).get(group.id, 1)
        cells[3] += f" (best of {of})" if of > 1 else ""
        for column in compared:
            cells[column] = Text(str(cells[column]), style=COLOURS.get(group.verdict or "", ""))
        lines.append(("" if group.task == last else cells[0], *cells[1:]))
        last = group.task
    return table(COLUMNS, lines, title + (f"; all with {settings_text(common)}" if common else ""))
