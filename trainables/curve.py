"""The evaluation curve of a cell as columns of plain numbers, and what is read off it."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field

Columns = Mapping[str, Sequence[float | int | None]]
"""One list per column, all of one length; None where a point lacks the value."""

FIELDS = ("episode", "step", "greedy_return", "discounted_return", "training_return", "seconds")

LAST_SHARE = 0.1
"""Share of the curve that asymptotic performance averages."""


@dataclass(frozen=True)
class EvalPoint:
    """One greedy evaluation of a cell. Everything but `seconds` is equal, bit for bit, wherever the cell runs."""

    episode: int
    """Training episodes so far."""
    step: int
    """Training steps so far."""
    greedy_return: float
    """Undiscounted return of the greedy policy (see the agent for which policy that is)."""
    discounted_return: float
    """The same, discounted by gamma."""
    training_return: float | None
    """Mean undiscounted return of the training episodes since the last point; None before the first episode."""
    statistics: Mapping[str, float]
    """delta and gate statistics, by name; empty for an agent without a source."""
    seconds: float = field(compare=False, default=0.0)
    """Seconds since the cell started."""


def columns(points: Iterable[EvalPoint]) -> dict[str, list[float | int | None]]:
    """The curve as columns: the fields of EvalPoint, then its statistics by name."""
    items = list(points)
    names = list(dict.fromkeys(name for point in items for name in point.statistics))
    table: dict[str, list[float | int | None]] = {field: [getattr(p, field) for p in items] for field in FIELDS}
    return table | {name: [p.statistics.get(name) for p in items] for name in names}


def joined(before: Columns, after: Columns) -> dict[str, list[float | int | None]]:
    """Two parts of one curve as one; a column that one part lacks is filled up with None."""
    names = list(dict.fromkeys([*before, *after]))
    lengths = [len(part["episode"]) if part else 0 for part in (before, after)]
    missing = [[None] * length for length in lengths]
    return {name: [*before.get(name, missing[0]), *after.get(name, missing[1])] for name in names}


def digest(curve: Columns) -> str:
    """SHA-256 of every bit of the curve but its seconds: equal iff the two curves are."""
    data = {name: list(values) for name, values in curve.items() if name != "seconds"}
    text = json.dumps(data, sort_keys=True, separators=(",", ":"), allow_nan=False)
    return hashlib.sha256(text.encode()).hexdigest()


def auc(values: Sequence[float]) -> float:
    """Mean of an evaluation curve (the scale of the paper's Table 1)."""
    return sum(values) / len(values)


def asymptotic(values: Sequence[float]) -> float:
    """Asymptotic performance: the mean of the last tenth of the curve, at least one point."""
    last = max(1, round(len(values) * LAST_SHARE))
    return auc(values[-last:])
