"""A published dataset: cells.parquet, points/SWEEP.parquet, the search spaces, a data card, a licence, checksums."""

from __future__ import annotations

import functools
import re
from collections.abc import Collection, Iterator
from pathlib import Path

import pandas as pd

from orchestrator.dataset.rows import record_of
from orchestrator.results import checked_json
from orchestrator.results.records.record import Record
from orchestrator.results.sweep_folder import Results
from orchestrator.results.tables.parquet import read_table
from search_spaces.loading import parse
from search_spaces.search_space import SearchSpace
from trainables.errors import InputError, unknown

CELLS, POINTS, SPACES, SUMS = "cells.parquet", "points", "spaces", "SHA256SUMS"

LINE = re.compile(r"([0-9a-f]{64})  ([A-Za-z0-9_./-]+)")
"""A line of SHA256SUMS, as `sha256sum -c` reads it."""


class Dataset:
    """A dataset's folder, for reading. Raises InputError where it is none, or a file was changed."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self._check()

    def _check(self) -> None:
        try:
            lines = (self.folder / SUMS).read_text().splitlines()
        except OSError:
            raise InputError(f"{self.folder} is not a dataset: it has no {SUMS}") from None
        sums = {found[2]: found[1] for line in lines if (found := LINE.fullmatch(line))}
        for name in {CELLS, *sums}:
            if sums.get(name) != checked_json.digest(self.folder / name):
                raise InputError(f"{self.folder / name} is missing or damaged: its checksum is not that of {SUMS}")

    @functools.cached_property
    def cells(self) -> pd.DataFrame:
        """The cells table: one row per sweep and cell."""
        return read_table(self.folder / CELLS)

    def points(self, cell_ids: Collection[str] | None = None) -> pd.DataFrame:
        """Return the curves, or those of `cell_ids`: one row per cell and evaluation point, in order."""
        cells = self.cells.drop_duplicates("cell_id")
        wanted = cells if cell_ids is None else cells[cells["cell_id"].isin(cell_ids)]
        frames = [self._points(str(sweep), set(rows["cell_id"])) for sweep, rows in wanted.groupby("sweep")]
        return pd.concat(frames, ignore_index=True).sort_values(["cell_id", "episode"], ignore_index=True)

    def _points(self, sweep: str, cell_ids: set[str]) -> pd.DataFrame:
        path = self.folder / POINTS / f"{sweep}.parquet"
        return pd.read_parquet(path, filters=[("cell_id", "in", cell_ids)])

    def sweeps(self) -> list[str]:
        """Return the names of the sweeps in it."""
        return sorted(self.cells["sweep"].unique())

    def space(self, sweep: str) -> SearchSpace:
        """Return the search space of a sweep's last run. Raises InputError for a sweep that is not in the dataset."""
        if sweep not in self.sweeps():
            raise unknown(f"sweep in {self.folder}", sweep, self.sweeps())
        path = self.folder / SPACES / f"{sweep}.json"
        return parse(str(path), checked_json.read(path)["space"])

    def record(self, cell_id: str) -> Record:
        """Return the record of a cell. Raises InputError where there is none, or it was changed."""
        rows = self.cells[self.cells["cell_id"] == cell_id]
        if rows.empty:
            raise InputError(f"no cell {cell_id} in {self.folder}")
        return record_of(rows.iloc[0], self.points([cell_id]))

    def records(self, sweep: str) -> Iterator[Record]:
        """Yield the records of a sweep."""
        rows = self.cells[self.cells["sweep"] == sweep]
        points = dict(iter(self._points(sweep, set(rows["cell_id"])).groupby("cell_id", sort=False)))
        for _, row in rows.iterrows():
            yield record_of(row, points[row["cell_id"]])

    def restore(self, sweep: str, results: Results) -> int:
        """Write the records of `sweep` to `results`, and return how many were missing. Only for who holds its lock.

        Raises InputError as `record` and `Results.begin` do.
        """
        results.begin(self.space(sweep))
        there = results.heads()
        missing = [record for record in self.records(sweep) if record.cell.id not in there]
        if missing:
            results.add(*missing)
        return len(missing)
