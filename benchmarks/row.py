"""A figure beside its peer or its limit: what every benchmark comes to in the table of `make bench`."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass


@dataclass(frozen=True)
class Row:
    """One figure, measured in the same run as what it stands beside."""

    name: str
    value: float
    unit: str
    beside: str
    """What it is held against: a peer, or a limit."""
    other: float
    """The same figure of that."""
    more: bool = True
    """Whether more is better."""

    @property
    def ratio(self) -> float:
        """How many times better than what it stands beside; of a limit at most 1, but for noise."""
        over, under = (self.value, self.other) if self.more else (self.other, self.value)
        return over / under if under else float("nan")


def table(rows: Sequence[Row]) -> str:
    """Return the rows as a table of text."""
    lines = [f"{'':36}{'measured':>14}  {'':18}{'beside':<30}{'':>14}{'ratio':>8}"]
    for row in rows:
        figures = f"{_short(row.value):>14}  {row.unit:<18}{row.beside:<30}{_short(row.other):>14}"
        lines.append(f"{row.name:<36}{figures}{row.ratio:>8.2f}")
    return "\n".join(lines)


def _short(value: float) -> str:
    return f"{value:,.0f}" if abs(value) >= 1000 else f"{value:.4g}"
