"""The record of one ended cell: the cell, its outcome, and its provenance."""

from __future__ import annotations

import functools
import json
import zlib
from typing import Any, Literal, NamedTuple

from pydantic import BaseModel, ConfigDict, ValidationError

from trainables import curve
from trainables.cell import Cell
from trainables.errors import InputError, from_validation

SCHEMA = 1

Status = Literal["done", "failed", "stopped"]
"""stopped: a scheduler has stopped it early, so that its curve is shorter."""

Summary = dict[str, float | int | None]


class _Ended(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid", strict=True, arbitrary_types_allowed=True)

    cell: Cell
    status: Status
    error: str | None = None
    """Why it failed, or was stopped, in a sentence."""
    digest: str
    """`curve.digest` of its points, which identifies the curve."""
    finished: float
    """Seconds since 1970."""
    seconds: float
    """Wall time of the cell."""
    versions: dict[str, str]
    commit: str


class Head(_Ended):
    """A record without its curve: small enough to keep those of a whole sweep in memory."""

    summary: Summary
    """The curve's columns of the cells table; empty for a cell that is not done."""


class Record(_Ended):
    """A record with its curve."""

    points: dict[str, list[float | int | None]]
    """The evaluation curve as columns; for a failed or stopped cell, up to its end."""

    @property
    def returns(self) -> list[float]:
        """Return the greedy returns of the evaluation curve."""
        return [float(value) for value in self.points["greedy_return"] if value is not None]

    @functools.cached_property
    def head(self) -> Head:
        """Return the record without its curve."""
        shared = {name: getattr(self, name) for name in _Ended.model_fields}
        return Head.model_construct(**shared, summary=_summary(self))

    def to_line(self) -> bytes:
        """Return a line of a record log: checksum, cell id, head and curve, separated by tabs."""
        head = {"schema": SCHEMA, **self.head.model_dump(exclude={"cell"}), "cell": self.cell.to_json()}
        texts = (json.dumps(part, separators=(",", ":"), allow_nan=False) for part in (head, self.points))
        body = "\t".join((self.cell.id, *texts)).encode()
        return b"%08x\t%b\n" % (zlib.crc32(body), body)


class Line(NamedTuple):
    """A line of a record log whose checksum was verified, not yet parsed."""

    cell_id: str
    head: bytes
    points: bytes


def id_on(data: bytes) -> str:
    """Return the cell id on a line without verifying it, for an index; `split_line` says whether the line is whole."""
    return data[9:25].decode("ascii", errors="replace")  # after the checksum and a tab


def split_line(data: bytes) -> Line | None:
    """Return the parts of a line (with or without its end), or None where it is damaged."""
    checksum, tab, body = data.rstrip(b"\n").partition(b"\t")
    parts = body.split(b"\t")
    if not tab or len(parts) != 3 or checksum != b"%08x" % zlib.crc32(body):
        return None
    return Line(parts[0].decode(), parts[1], parts[2])


def read_head(line: Line) -> Head:
    """Return the head of a line. Raises InputError for another schema."""
    return Head.model_validate(_head(line))


def read_record(line: Line) -> Record:
    """Return the whole record of a line. Raises InputError for another schema, or a curve with another digest."""
    fields = _head(line)
    fields.pop("summary", None)
    try:
        record = Record.model_validate(fields | {"points": json.loads(line.points)})
    except (ValidationError, ValueError) as error:
        raise InputError(f"the record of cell {line.cell_id} cannot be read: {error}") from None
    if curve.digest(record.points) != record.digest:
        raise InputError(f"the curve of cell {line.cell_id} does not agree with its digest")
    return record


def _head(line: Line) -> dict[str, Any]:
    """Return the fields of a head, with its Cell. Raises InputError as `read_head` does."""
    try:
        fields: Any = json.loads(line.head)
        if not isinstance(fields, dict) or fields.pop("schema", None) != SCHEMA:
            raise InputError(f"the record of cell {line.cell_id} is not of schema {SCHEMA}")
        fields["cell"] = Cell.from_json(fields.get("cell"))
        Head.model_validate(fields)
    except ValidationError as error:
        raise from_validation(f"record of cell {line.cell_id}", error) from None
    except ValueError as error:
        raise InputError(f"the record of cell {line.cell_id} cannot be read: {error}") from None
    if fields["cell"].id != line.cell_id:
        raise InputError(f"the record of cell {line.cell_id} holds the cell {fields['cell'].id}")
    return fields


def _summary(record: Record) -> Summary:
    if record.status != "done":
        return {}
    points, returns = record.points, record.returns
    training = [value for value in points["training_return"] if value is not None]
    steps = points["step"][-1]
    summary: Summary = {
        "auc": curve.auc(returns),
        "training_auc": curve.auc(training),
        "initial_return": returns[0],
        "final_return": returns[-1],
        "best_return": max(returns),
        "asymptotic": curve.asymptotic(returns),
        "steps": steps,
        "steps_per_second": (steps or 0) / record.seconds if record.seconds else None,
    }
    extra = sorted(set(points) - {*curve.FIELDS})
    summary |= {f"final_{name}": points[name][-1] for name in extra}
    return summary | {f"mean_{name}": curve.mean(points[name]) for name in extra if name.startswith(curve.ADVISED)}
