"""The files of a sweep's tables: cells.parquet, points.parquet, and tables.json with their digests."""

from __future__ import annotations

import logging
import tempfile
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from orchestrator.results import checked_json
from orchestrator.results.checked_json import digest
from orchestrator.results.records.record import Record
from trainables.errors import InputError

if TYPE_CHECKING:
    import pandas as pd

log = logging.getLogger("deltatune.results")

CELLS, POINTS, TABLES = "cells.parquet", "points.parquet", "tables.json"
"""The tables, and the file with their digests."""


@dataclass(frozen=True)
class TableFiles:
    """The tables in `folder`, which are rebuilt whenever they are not those of the present records."""

    folder: Path
    stamp: Callable[[], str]
    """Returns a text that changes with the data from which the tables are built."""
    rows: Callable[[], list[dict[str, Any]]]
    """Returns the rows of the cells table."""
    records: Callable[[], Iterator[Record]]
    """Yields the records of the points table."""
    ended: Callable[[], int]
    """Returns the number of ended cells, including those that the sweep no longer asks for."""

    def write(self) -> tuple[pd.DataFrame, pd.DataFrame]:
        """Build both tables, write them as Parquet, and return (cells, points)."""
        stamp = self.stamp()
        self._build(self.folder)
        digests = {name: digest(self.folder / name) for name in (CELLS, POINTS)}
        checked_json.write(self.folder / TABLES, {"schema": 1, "stamp": stamp, "ended": self.ended(), **digests})
        return _read(self.folder)

    def read(self) -> tuple[pd.DataFrame, pd.DataFrame]:
        """Return (cells, points), rebuilt where a cell has ended since they were written, or a file is damaged.

        Those of a read-only folder are built in a temporary one.
        """
        if self._valid():
            return _read(self.folder)
        try:
            return self.write()
        except OSError as error:
            log.info("the tables are built in a temporary folder: %s", error)
            with tempfile.TemporaryDirectory(prefix="deltatune-") as folder:
                self._build(Path(folder))
                return _read(Path(folder))

    def ended_before(self) -> int:
        """Return the number of ended cells when the tables were written last; 0 where it is unknown."""
        return int((self._file() or {}).get("ended", 0))

    def _build(self, folder: Path) -> None:
        import pandas as pd

        from orchestrator.results.tables.parquet import write_points, write_table

        cells = pd.DataFrame(self.rows())
        write_points(folder / POINTS, self.records())
        write_table(folder / CELLS, cells)

    def _file(self) -> dict[str, Any] | None:
        """Return tables.json; None where it is missing or damaged, and the tables have to be rebuilt."""
        try:
            return checked_json.read(self.folder / TABLES)
        except InputError:
            return None

    def _valid(self) -> bool:
        """Return whether the tables are undamaged, and those of the present data."""
        file = self._file()
        if file is None or file.get("stamp") != self.stamp():
            return False
        return all(file.get(name) == digest(self.folder / name) for name in (CELLS, POINTS))


def _read(folder: Path) -> tuple[pd.DataFrame, pd.DataFrame]:
    from orchestrator.results.tables.parquet import read_table

    return read_table(folder / CELLS), read_table(folder / POINTS)
