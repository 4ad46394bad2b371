"""Writes a dataset: the done cells of sweeps, with everything needed to read, verify and replay them."""

from __future__ import annotations

import shutil
import tempfile
from collections.abc import Sequence
from pathlib import Path

import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq

from orchestrator.dataset.card import LICENCE, card
from orchestrator.dataset.dataset import CELLS, POINTS, SPACES, SUMS, Dataset
from orchestrator.dataset.rows import WHOLE, cell_row, point_rows
from orchestrator.results import checked_json
from orchestrator.results.records.record import Record
from orchestrator.results.sweep_folder import Results
from trainables.errors import InputError
from trainables.storage.folders import make_folder


def write(folder: Path, sweeps: Sequence[Results], remarks: str = "") -> Dataset:
    """Write the done cells of `sweeps` to the dataset `folder`, next to its other sweeps, and return it.

    remarks: Markdown for the data card. Raises InputError for a sweep without a done cell, or a folder with files that
    do not belong to a dataset.
    """
    before = Dataset(folder) if (folder / SUMS).exists() else None
    make_folder(folder)
    if before is None and any(folder.iterdir()):
        raise InputError(f"{folder} is not empty, and not a dataset")
    frames = {results.name: _frames(results) for results in sweeps}
    kept = before.cells[~before.cells["sweep"].isin(list(frames))] if before else pd.DataFrame()
    cells = _joined([kept, *(cells for cells, _ in frames.values())]).sort_values(["sweep", "cell_id"])
    with tempfile.TemporaryDirectory(dir=folder.parent, prefix=".dataset-") as made:
        new = Path(made)
        if before:
            for name in (POINTS, SPACES):
                shutil.copytree(folder / name, new / name)
        pq.write_table(pa.Table.from_pandas(cells, preserve_index=False), new / CELLS, compression="zstd")
        for results in sweeps:
            _put_points(make_folder(new / POINTS) / f"{results.name}.parquet", frames[results.name][1])
            space = {"schema": 1, "space": results.space().to_json()}
            checked_json.write(make_folder(new / SPACES) / f"{results.name}.json", space, indent=1)
        (new / "LICENSE").write_text(LICENCE)
        (new / "README.md").write_text(card(cells, remarks))
        _seal(new)
        Dataset(new)
        for path in sorted(path for path in new.rglob("*") if path.is_file()):
            shutil.copyfile(path, make_folder((folder / path.relative_to(new)).parent) / path.name)
    return Dataset(folder)


def _frames(results: Results) -> tuple[pd.DataFrame, pd.DataFrame]:
    """Return the sweep's cells and points."""
    done: list[Record] = [record for _, _, record in results.records() if record and record.status == "done"]
    if not done:
        raise InputError(f"the sweep {results.name} has no done cell")
    cells = pd.DataFrame([cell_row(results.name, record) for record in done])
    return cells, _joined([point_rows(record) for record in done])


def _joined(frames: Sequence[pd.DataFrame]) -> pd.DataFrame:
    """Return the rows of all frames, with the columns of any."""
    tables = [pa.Table.from_pandas(frame, preserve_index=False) for frame in frames if len(frame)]
    joined: pd.DataFrame = pa.concat_tables(tables, promote_options="permissive").to_pandas()
    return joined


def _put_points(path: Path, points: pd.DataFrame) -> None:
    """Write the curves of a sweep, sorted and small."""
    ordered = points.sort_values(["cell_id", "episode"])
    pq.write_table(
        pa.Table.from_pandas(ordered, preserve_index=False),
        path,
        compression="zstd",
        compression_level=15,
        use_dictionary=[name for name in points.columns if name not in WHOLE],
        row_group_size=50_000,
    )


def _seal(folder: Path) -> None:
    """Write the checksums of all files."""
    names = sorted(path.relative_to(folder).as_posix() for path in folder.rglob("*") if path.is_file())
    lines = [f"{checked_json.digest(folder / name)}  {name}\n" for name in names]
    (folder / SUMS).write_text("".join(lines))
