"""The evaluation curve of a cell as columns of plain numbers, and statistics of it."""

from __future__ import annotations

import hashlib
import json
import math
import operator
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from trainables.errors import TrainingError

Columns = Mapping[str, Sequence[float | int | None]]
"""One list per column, all of one length; None where a point lacks the value."""

FIELDS = ("episode", "step", "greedy_return", "discounted_return", "training_return", "seconds")

ADVISED = "advised_"
"""How statistics begin that are of the advised steps since the last evaluation: they are None where there is none."""

LAST_SHARE = 0.1
"""Share of the curve that asymptotic performance averages."""


@dataclass(frozen=True)
class EvalPoint:
    """One greedy evaluation of a cell. All but `seconds` is bit for bit the same wherever the cell runs."""

    episode: int
    """Training episodes so far."""
    step: int
    """Training steps so far."""
    greedy_return: float
    """Undiscounted return of the greedy policy (the agent defines which policy that is)."""
    discounted_return: float
    """The same, discounted by gamma."""
    training_return: float | None
    """Mean undiscounted return of the training episodes since the last point; None before the first episode."""
    statistics: Mapping[str, float]
    """delta and gate statistics, by name; empty for an agent without a source."""
    seconds: float = field(compare=False, default=0.0)
    """Seconds since the cell started."""

    @classmethod
    def checked(cls, point: object, seconds: float) -> EvalPoint:
        """Return a learner's point with plain Python numbers. Raises TrainingError unless all are finite numbers."""
        if not isinstance(point, EvalPoint):
            raise TrainingError(f"evaluate() must return an EvalPoint (got {type(point).__name__})")
        episode, step = (_count(name, getattr(point, name)) for name in ("episode", "step"))
        trained = point.training_return
        if not isinstance(point.statistics, Mapping):
            raise TrainingError(f"the statistics must map names to numbers (got {point.statistics!r:.80})")
        return cls(
            episode=episode,
            step=step,
            greedy_return=_finite("greedy return", point.greedy_return, episode),
            discounted_return=_finite("discounted return", point.discounted_return, episode),
            training_return=None if trained is None else _finite("training return", trained, episode),
            statistics={
                str(name): _finite(f"statistic '{name}'", value, episode) for name, value in point.statistics.items()
            },
            seconds=seconds,
        )


def _count(name: str, value: Any) -> int:
    try:
        return operator.index(value)
    except TypeError:
        raise TrainingError(f"evaluate() must return a whole number as {name} (got {value!r})") from None


def _finite(name: str, value: Any, episode: int) -> float:
    """Return `value` as a finite Python number."""
    number = value
    if type(value) not in (int, float):
        try:
            number = float(value)
        except (TypeError, ValueError):
            raise TrainingError(f"the {name} must be a number (got {value!r} after episode {episode})") from None
    if not math.isfinite(number):
        raise TrainingError(f"the {name} is {number} after episode {episode}")
    plain: float = number
    return plain


def columns(points: Iterable[EvalPoint]) -> dict[str, list[float | int | None]]:
    """Return the curve as columns: the fields of EvalPoint, then its statistics by name."""
    items = list(points)
    names = list(dict.fromkeys(name for point in items for name in point.statistics))
    table: dict[str, list[float | int | None]] = {field: [getattr(p, field) for p in items] for field in FIELDS}
    return table | {name: [p.statistics.get(name) for p in items] for name in names}


def joined(before: Columns, after: Columns) -> dict[str, list[float | int | None]]:
    """Return two parts of a curve as one; a column that one part lacks is filled with None."""
    names = list(dict.fromkeys([*before, *after]))
    lengths = [len(part["episode"]) if part else 0 for part in (before, after)]
    missing = [[None] * length for length in lengths]
    return {name: [*before.get(name, missing[0]), *after.get(name, missing[1])] for name in names}


def checked(value: object) -> dict[str, list[float | int | None]]:
    """Return `value` if it is a curve as `columns` returns it. Raises ValueError for anything else."""
    if not isinstance(value, dict) or not set(FIELDS) <= set(value):
        raise ValueError(f"a curve needs the columns {', '.join(FIELDS)}")
    if len({len(column) for column in value.values()}) != 1:
        raise ValueError("the columns of a curve must have one length")
    return {str(name): list(column) for name, column in value.items()}


def digest(curve: Columns) -> str:
    """Return the SHA-256 of every bit of the curve except its seconds; equal iff the curves are."""
    data = {name: list(values) for name, values in curve.items() if name != "seconds"}
    text = json.dumps(data, sort_keys=True, separators=(",", ":"), allow_nan=False)
    return hashlib.sha256(text.encode()).hexdigest()


def mean(values: Sequence[float | int | None]) -> float | None:
    """Return the mean of a column's numbers; None where it has none."""
    given = [value for value in values if value is not None]
    return sum(given) / len(given) if given else None


def auc(values: Sequence[float]) -> float:
    """Return the mean of an evaluation curve (the scale of the paper's Table 1)."""
    return sum(values) / len(values)


def asymptotic(values: Sequence[float]) -> float:
    """Return asymptotic performance: the mean of the last tenth of the curve, at least one point."""
    last = max(1, round(len(values) * LAST_SHARE))
    return auc(values[-last:])
