"""Tables for a terminal."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from rich.text import Text

from deltatune.cli.sheet import Sheet, table

if TYPE_CHECKING:
    from orchestrator.analysis.contrasts.contrast import Contrast
    from orchestrator.analysis.contrasts.decisions import Decision
    from orchestrator.analysis.groups import Group
    from search_spaces.search_space import SearchSpace

__all__ = ["COLOURS", "confirmed_table", "contrast_table", "decision_table", "duration", "group_table", "span", "table"]

COLOURS = {"helped": "green", "hurt": "red", "better": "green", "worse": "red"}
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


def group_table(groups: Sequence[Group], title: str) -> Sheet:
    """Return groups as a results table, task by task; green where transfer helped, red where it hurt.

    Statistics that no group has are left out, and settings that all groups share are in the title.
    """
    from orchestrator.analysis.labels import settings_text, shared
    from orchestrator.analysis.metrics import shown
    from orchestrator.analysis.tables.summary_table import table as lines_of

    common, compared = shared(groups), {metric.heading for metric in shown("summary") if metric.compared}
    ordered = sorted(groups, key=lambda group: group.task)
    columns, rows = lines_of(ordered, common)
    lines: list[tuple[str | Text, ...]] = []
    last = ""
    for group, texts in zip(ordered, rows, strict=True):
        colour = COLOURS.get(group.verdict or "", "")
        cells: list[str | Text] = [
            Text(text, style=colour) if name in compared or name == "verdict" else text
            for name, text in zip(columns, texts, strict=True)
        ]
        cells[3] = texts[3] + (f" (best of {group.tried})" if group.tried > 1 and not group.confirmed else "")
        lines.append(("" if group.task == last else cells[0], *cells[1:]))
        last = group.task
    return table(columns, lines, title + (f"; all with {settings_text(common)}" if common else ""))


def contrast_table(found: Sequence[Contrast], title: str) -> Sheet:
    """Contrasts, task by task; green where A is better, red where it is worse."""
    from orchestrator.analysis.contrasts.table import COLUMNS, GAP, row

    lines: list[tuple[str | Text, ...]] = []
    last = ""
    for contrast in found:
        cells: list[str | Text] = list(row(contrast))
        for name in ("verdict", GAP):
            cells[COLUMNS.index(name)] = Text(str(cells[COLUMNS.index(name)]), style=COLOURS.get(contrast.verdict, ""))
        lines.append(("" if contrast.first.task == last else cells[0], *cells[1:]))
        last = contrast.first.task
    return table(COLUMNS, lines, title)


def decision_table(found: Sequence[Decision], space: SearchSpace) -> Sheet:
    """Return the decisions of a sequential test over seeds; green where A is better, red where it is worse."""
    from orchestrator.analysis.contrasts.decisions import COLUMNS, caption, rows

    lines: list[tuple[str | Text, ...]] = []
    last = ""
    for decision, (*cells, said) in zip(found, rows(found), strict=True):
        colour = COLOURS.get(decision.outcome.state, "")
        lines.append(("" if decision.task == last else cells[0], *cells[1:], Text(said, style=colour)))
        last = decision.task
    return table(COLUMNS, lines, caption(found, space))


def confirmed_table(groups: Sequence[Group]) -> Sheet:
    """Return what a confirmation says of the selected configurations, next to the AUC that they were selected by."""
    from orchestrator.analysis.metrics import METRICS
    from orchestrator.analysis.tables.summary_table import CONFIRMED, CONFIRMED_COLUMNS, confirmed_texts
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
