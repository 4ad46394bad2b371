"""Tables for a terminal."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

from rich.text import Text

from deltatune.cli.sheet import Sheet, table

if TYPE_CHECKING:
    from orchestrator.analysis.groups import Group

__all__ = ["COLOURS", "confirmed_table", "duration", "group_table", "span", "table"]

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


def confirmed_table(groups: Sequence[Group]) -> Sheet:
    """Return what a confirmation says of the selected configurations, next to the AUC that they were selected by."""
    from orchestrator.analysis.metrics import METRICS
    from orchestrator.analysis.summary_table import CONFIRMED, CONFIRMED_COLUMNS, confirmed_texts
    from trainables.plugins.names import short

    auc = next(metric for metric in METRICS if metric.key == "auc")
    lines: list[tuple[str | Text, ...]] = []
    for group in sorted(groups, key=lambda group: group.task):
        seeds, *texts = confirmed_texts(group.confirmed)
        style = COLOURS.get((group.confirmed.verdict if group.confirmed else "") or "", "")
        shown = [
            Text(text, style=style) if metric.compared else text for metric, text in zip(CONFIRMED, texts, strict=True)
        ]
        lines.append((short(group.task), short(group.agent), group.source_label, auc.text(group.auc), seeds, *shown))
    columns = ("task", "agent", "source", "selected by AUC", *CONFIRMED_COLUMNS)
    return table(columns, lines, "Confirmed on seeds that had no part in the selection")
