"""Conversion of a record to rows of a dataset's tables and back, without losing a bit."""

from __future__ import annotations

import json
from collections.abc import Sequence
from typing import Any

import pandas as pd
from pydantic import ValidationError

from orchestrator.results.records.record import Record
from trainables import curve
from trainables.cell import Cell
from trainables.errors import InputError, from_validation

WHOLE = ("episode", "step")
"""The columns of every curve that hold whole numbers."""


def cell_row(sweep: str, record: Record) -> dict[str, Any]:
    """Return the row of the cells table for a done record.

    Besides what a reader needs it has the cell's JSON, the digest of its curve, and which of the curve's columns are
    integers, since a Parquet column of the points has one type for all cells.
    """
    cell = record.cell
    source = cell.sources[0] if cell.sources else None
    row: dict[str, Any] = {
        "sweep": sweep,
        "cell_id": cell.id,
        "agent": cell.agent,
        "task": cell.task,
        "source_task": source.task if source else None,
        "source": source.kind if source else "none",
        "source_cell": source.cell_id if source else None,
        "seed": cell.seed,
        "group": cell.group,
    }
    row |= {name: value for name, value in record.head.summary.items() if not name.startswith(("final_", "steps_per"))}
    row |= {"seconds": record.seconds, "finished": record.finished, "commit": record.commit, "digest": record.digest}
    row |= {"versions": json.dumps(record.versions, sort_keys=True)}
    row |= {
        "columns": json.dumps(
            {name: _kind(name, values) for name, values in record.points.items() if name != "seconds"}
        )
    }
    return row | {"cell": json.dumps(cell.to_json(), sort_keys=True)}


def _kind(name: str, values: Sequence[float | int | None]) -> str:
    """Return 'int' or 'float'. Raises InputError for a column that holds both."""
    kinds = {type(value).__name__ for value in values if value is not None}
    if len(kinds) > 1:
        raise InputError(f"the curve's column '{name}' mixes whole numbers and fractions: a dataset cannot hold it")
    return kinds.pop() if kinds else "float"


def point_rows(record: Record) -> pd.DataFrame:
    """Return the curve as a table, one row per evaluation point, with the cell's id first and without its seconds."""
    columns = {name: values for name, values in record.points.items() if name != "seconds"}
    table = pd.DataFrame({name: pd.Series(values, dtype=_dtype(name)) for name, values in columns.items()})
    table.insert(0, "cell_id", record.cell.id)
    return table


def _dtype(name: str) -> str:
    return "int64" if name in WHOLE else "float64"


def record_of(row: pd.Series, points: pd.DataFrame) -> Record:
    """Return the record that `row` and its cell's `points` were made of, its seconds spread evenly over the curve.

    Raises InputError where they are not what was published, or their agent or task is not known here.
    """
    kinds = json.loads(row["columns"])
    table = {name: _column(points[name], kind) for name, kind in kinds.items() if name in points}
    table["seconds"] = [float(row["seconds"]) * part / max(1, len(points) - 1) for part in range(len(points))]
    fields = {
        "cell": Cell.from_json(json.loads(row["cell"])),
        "status": "done",
        "digest": row["digest"],
        "finished": float(row["finished"]),
        "seconds": float(row["seconds"]),
        "versions": json.loads(row["versions"]),
        "commit": row["commit"],
        "points": table,
    }
    try:
        record = Record.model_validate(fields)
    except ValidationError as error:
        raise from_validation(f"published cell {row['cell_id']}", error) from None
    if curve.digest(record.points) != record.digest or record.cell.id != row["cell_id"]:
        raise InputError(f"the published cell {row['cell_id']} does not agree with its digest")
    return record


def _column(values: pd.Series, kind: str) -> list[float | int | None]:
    make = int if kind == "int" else float
    return [None if missing else make(value) for value, missing in zip(values, values.isna(), strict=True)]
