"""A figure compared with a peer or limit: a row in the table of `make bench`."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass


@dataclass(frozen=True)
class Row:
    """One figure, measured in the same run as its peer or limit."""

    name: str
    value: float
    unit: str
    beside: str
    """The peer or limit that it is compared with."""
    other: float
    """The peer's figure, or the limit."""
    more: bool = True
    """Whether more is better."""

    @property
    def ratio(self) -> float:
        """How many times better it is than the peer; for a limit at most 1, except for noise."""
        over, under = (self.value, self.other) if self.more else (self.other, self.value)
        return over / under if under else float("nan")


def table(rows: Sequence[Row]) -> str:
    """Return the rows as a table of text."""
    lines = [f"{'':36}{'measured':>14}  {'':18}{'compared with':<30}{'':>14}{'ratio':>8}"]
    for row in rows:
        figures = f"{_short(row.value):>14}  {row.unit:<18}{row.beside:<30}{_short(row.other):>14}"
        lines.append(f"{row.name:<36}{figures}{row.ratio:>8.2f}")
    return "\n".join(lines)


def _short(value: float) -> str:
    return f"{value:,.0f}" if abs(value) >= 1000 else f"{value:.4g}"
