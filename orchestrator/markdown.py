"""Tables in Markdown."""

from __future__ import annotations

from collections.abc import Iterable


def table(head: Iterable[object], rows: Iterable[Iterable[object]]) -> list[str]:
    """Return the lines of a table. A `|` in a cell is the caller's to replace."""
    names = [str(name) for name in head]
    return [_line(names), "|" + "---|" * len(names), *(_line(map(str, row)) for row in rows)]


def _line(cells: Iterable[str]) -> str:
    return f"|{'|'.join(cells)}|"
