"""Tables for a terminal, printed as one card per row where it is too narrow."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field

import rich.box
from rich.console import Console, ConsoleOptions, RenderResult
from rich.padding import Padding
from rich.table import Table
from rich.text import Text

MIN_PROSE = 16
"""Least width of a column of running text, in characters; a word is never broken."""

GAP = 2
"""Characters between two columns of a table."""


@dataclass
class Sheet:
    """Rows under columns: a table where it fits, else a card per row. An empty first cell repeats the one above."""

    columns: tuple[str, ...]
    title: str | None = None
    rows: list[tuple[Text, ...]] = field(default_factory=list)

    def __rich_console__(self, console: Console, options: ConsoleOptions) -> RenderResult:
        """Yield the table or the cards."""
        if sum(self._least(at) + GAP for at in range(len(self.columns))) <= options.max_width:
            yield self._table()
            return
        if self.title:
            yield Text(self.title, style="italic")
        for row in self.rows:
            first, *rest = zip(self.columns, row, strict=True)
            if first[1].plain:
                yield Text.assemble(first[1], style="bold")
            yield Padding(self._card(rest), (0, 0, 0, 2))

    def _card(self, cells: Sequence[tuple[str, Text]]) -> Text:
        """Return all cells of a row but the first as one paragraph, without the empty ones."""
        said = [(name, cell) for name, cell in cells if cell.plain not in ("", "-")]
        parts = [Text.assemble((f"{name} " if name else "", "dim"), cell) for name, cell in said]
        return Text(" · ").join(parts)

    def _table(self) -> Table:
        result = Table(title=self.title, box=rich.box.SIMPLE_HEAD, title_justify="left", pad_edge=False)
        for at, column in enumerate(self.columns):
            result.add_column(column, overflow="fold", no_wrap=at == 0, min_width=self._least(at))
        for row in self.rows:
            result.add_row(*row)
        return result

    def _least(self, at: int) -> int:
        """Return a column's least width: its longest word, at least MIN_PROSE for running text."""
        texts = [self.columns[at], *(row[at].plain for row in self.rows)]
        if at == 0:
            return max(len(text) for text in texts)
        longest = max((len(word) for text in texts for word in text.split()), default=0)
        return max(longest, min(MIN_PROSE, max(len(text) for text in texts)))


def table(columns: Sequence[str], rows: Iterable[Sequence[str | Text]], title: str | None = None) -> Sheet:
    """Return rows as a table, or as cards in a narrow terminal. No text is read as markup."""
    cells = [tuple(Text(cell) if isinstance(cell, str) else cell for cell in row) for row in rows]
    return Sheet(tuple(columns), title, cells)
