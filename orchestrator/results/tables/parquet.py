"""The results tables as Parquet files, written in chunks."""

from __future__ import annotations

import io
import tempfile
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq

from orchestrator.results.records.record import Record
from trainables.storage.paths import is_local

ROWS = 200_000
"""Rows held in memory while the points are written."""

_INTEGERS = ("episode", "step")


def write_table(path: Path, table: pd.DataFrame) -> None:
    """Write a table."""
    arrow = pa.Table.from_pandas(table, preserve_index=False)
    with tempfile.TemporaryDirectory(dir=_near(path)) as folder:
        pq.write_table(arrow, Path(folder) / path.name)
        _put(Path(folder) / path.name, path)


def write_points(path: Path, records: Iterable[Record]) -> None:
    """Write the curves of `records`: a row per cell and evaluation point, null where a curve lacks a column.

    The columns are those of all records together, so the chunks are joined at the end; ROWS bounds the memory.
    """
    with tempfile.TemporaryDirectory(dir=_near(path)) as folder:
        pieces = list(_pieces(records, Path(folder)))
        fields = {name: None for piece in pieces for name in pq.read_schema(piece).names}
        names = ["cell_id", *(name for name in fields if name != "cell_id")]
        schema = pa.schema([(name, _type(name)) for name in names])
        with pq.ParquetWriter(Path(folder) / path.name, schema) as writer:
            for piece in pieces:
                writer.write_table(_filled(pq.read_table(piece), schema))
        _put(Path(folder) / path.name, path)


def read_table(path: Path) -> pd.DataFrame:
    """Return a table that `write_table` or `write_points` wrote."""
    return pd.read_parquet(path if is_local(path) else io.BytesIO(path.read_bytes()))


def _pieces(records: Iterable[Record], folder: Path) -> Iterable[Path]:
    """Yield files of about ROWS rows of the curves, each with the columns that it needs."""
    batch: list[Record] = []
    rows = 0
    for record in records:
        batch.append(record)
        rows += len(record.points["episode"])
        if rows >= ROWS:
            yield _write_piece(batch, folder)
            batch, rows = [], 0
    if batch:
        yield _write_piece(batch, folder)


def _write_piece(batch: list[Record], folder: Path) -> Path:
    names = list(dict.fromkeys(name for record in batch for name in record.points))
    columns: dict[str, list[Any]] = {name: [] for name in names}
    ids: list[str] = []
    for record in batch:
        length = len(record.points["episode"])
        ids += [record.cell.id] * length
        for name in names:
            columns[name] += record.points.get(name, [None] * length)
    arrays = {"cell_id": pa.array(ids), **{name: pa.array(v, _type(name)) for name, v in columns.items()}}
    path = folder / f"piece{len(list(folder.iterdir()))}.parquet"
    pq.write_table(pa.table(arrays), path)
    return path


def _filled(table: pa.Table, schema: pa.Schema) -> pa.Table:
    columns = {
        field.name: table[field.name] if field.name in table.column_names else pa.nulls(len(table), field.type)
        for field in schema
    }
    return pa.table(columns, schema=schema)


def _type(name: str) -> pa.DataType:
    if name == "cell_id":
        return pa.string()
    return pa.int64() if name in _INTEGERS else pa.float64()


def _near(path: Path) -> Path | None:
    """Return the folder for a temporary file that will replace `path`, on the same disk; None: any folder."""
    return path.parent if is_local(path) else None


def _put(made: Path, path: Path) -> None:
    if is_local(path):
        made.replace(path)
    else:
        path.write_bytes(made.read_bytes())
