"""The results of one sweep on disk: the truth that statistics, figures and MLflow are drawn from.

SWEEP/sweep.json        the search space, as last run
SWEEP/plan.json         every cell that it asks for, by stage
SWEEP/cells/ID.json     the record of an ended cell, written whole when it ends
SWEEP/cells.parquet     one row per planned cell             } written from the above
SWEEP/points.parquet    one row per cell and evaluation point } after each run
"""

from __future__ import annotations

import json
import re
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pandas as pd

from orchestrator.files import make_folder
from orchestrator.provenance import commit, versions
from orchestrator.record import Record
from search_spaces import SearchSpace, parse
from trainables.atomic import write_atomic
from trainables.cell import Cell
from trainables.curve import asymptotic, auc
from trainables.errors import InputError, unknown

NAME = re.compile(r"^[A-Za-z0-9][A-Za-z0-9_.-]{0,63}$")

Plan = dict[str, list[Cell]]
"""Stage name to its cells, in order."""


class Results:
    """One sweep's folder. Make one with `create` or `open`."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self._cells = folder / "cells"

    @classmethod
    def create(cls, storage: Path, name: str, space: SearchSpace) -> Results:
        """The folder of the sweep `name` in `storage`, new or grown by `space`.

        Raises InputError for a bad name, a folder that cannot be written to, or one of another search space.
        """
        if not NAME.match(name):
            raise InputError(f"a sweep's name must be letters, digits, dots, dashes and underscores (got '{name}')")
        results = cls(make_folder(storage / name))
        make_folder(results._cells)
        created = time.time()
        if (results.folder / "sweep.json").exists():
            before = results.meta()
            created = before["created"]
            if before["space"]["name"] != space.name:
                other = before["space"]["name"]
                raise InputError(f"the sweep '{name}' belongs to the search space '{other}': choose another --name")
        meta = {"schema": 1, "name": name, "created": created, "space": space.to_json()}
        meta |= {"commit": commit(), "versions": versions()}
        write_atomic(results.folder / "sweep.json", json.dumps(meta, indent=1).encode())
        return results

    @classmethod
    def open(cls, storage: Path, sweep: str) -> Results:
        """An existing sweep by its name in `storage`, or by its folder; InputError with the list of what there is."""
        for folder in (storage / sweep, Path(sweep)):
            if (folder / "sweep.json").is_file():
                return cls(folder.expanduser().resolve())
        there = sorted(path.parent.name for path in storage.glob("*/sweep.json"))
        raise unknown(f"sweep in {storage}", sweep, there)

    @property
    def name(self) -> str:
        """The sweep's name: its folder's."""
        return self.folder.name

    @property
    def storage(self) -> Path:
        """The folder that this sweep shares with others: the source library and MLflow's store are there."""
        return self.folder.parent

    def meta(self) -> dict[str, Any]:
        """sweep.json; InputError where it is damaged."""
        return _read_json(self.folder / "sweep.json")

    def space(self) -> SearchSpace:
        """The search space, as last run."""
        return parse(str(self.folder / "sweep.json"), self.meta().get("space"))

    def add(self, record: Record) -> None:
        """Write the record of an ended cell. From here on it is never lost, and never run again if it is done."""
        write_atomic(self._file(record.cell.id), record.to_bytes())

    def record(self, cell_id: str) -> Record | None:
        """The record of a cell, None where it has not ended; InputError where its file is damaged."""
        path = self._file(cell_id)
        if not path.exists():
            return None
        record = Record.from_bytes(path.read_bytes(), str(path))
        if record.cell.id != cell_id:
            raise InputError(
                f"{path} is damaged (it holds the cell {record.cell.id}): move it away and run the sweep again"
            )
        return record

    def set_plan(self, stages: Plan) -> None:
        """Write down which cells the sweep asks for now."""
        data = {"schema": 1, "stages": {name: [cell.to_json() for cell in cells] for name, cells in stages.items()}}
        write_atomic(self.folder / "plan.json", json.dumps(data, separators=(",", ":")).encode())

    def plan(self) -> Plan:
        """The cells that the sweep asks for, as last planned."""
        path = self.folder / "plan.json"
        if not path.exists():
            return {}
        stages = _read_json(path)["stages"]
        return {name: [Cell.from_json(cell) for cell in cells] for name, cells in stages.items()}

    def records(self) -> Iterator[tuple[str, Cell, Record | None]]:
        """(stage, cell, its record if it has ended) of every planned cell, each cell once."""
        seen: set[str] = set()
        for stage, cells in self.plan().items():
            for cell in cells:
                if cell.id not in seen:
                    seen.add(cell.id)
                    yield stage, cell, self.record(cell.id)

    def every_record(self) -> Iterator[Record]:
        """Every record in the folder, whether the plan still asks for its cell or not."""
        for path in sorted(self._cells.glob("*.json")):
            record = self.record(path.stem)
            if record is not None:
                yield record

    def write_tables(self) -> tuple[pd.DataFrame, pd.DataFrame]:
        """Draw the two tables up from the records, write them as Parquet, and return (cells, points)."""
        rows, curves = [], []
        for stage, cell, record in self.records():
            rows.append(cell_row(stage, cell, record))
            if record is not None:
                curves.append(pd.DataFrame(record.points).assign(cell_id=cell.id))
        cells = pd.DataFrame(rows)
        points = pd.concat(curves, ignore_index=True) if curves else pd.DataFrame({"cell_id": []})
        points = points[["cell_id", *(name for name in points.columns if name != "cell_id")]]
        for name, table in (("cells", cells), ("points", points)):
            temporary = self.folder / f".{name}.parquet"
            table.to_parquet(temporary, index=False)
            temporary.replace(self.folder / f"{name}.parquet")
        return cells, points

    def tables(self) -> tuple[pd.DataFrame, pd.DataFrame]:
        """(cells, points) as last written; drawn up anew where a cell has ended since."""
        paths = [self.folder / "cells.parquet", self.folder / "points.parquet"]
        newest = max((self._cells.stat().st_mtime_ns, _mtime(self.folder / "plan.json")))
        if all(_mtime(path) > newest for path in paths):
            return pd.read_parquet(paths[0]), pd.read_parquet(paths[1])
        return self.write_tables()

    def _file(self, cell_id: str) -> Path:
        if not re.fullmatch(r"[0-9a-f]{16}", cell_id):
            raise InputError(f"a cell id is 16 hexadecimal digits (got '{cell_id}')")
        return self._cells / f"{cell_id}.json"


def cell_row(stage: str, cell: Cell, record: Record | None) -> dict[str, Any]:
    """A cell's row of the cells table. A cell that is not done has no AUC: it is counted, never averaged."""
    source = cell.source
    row: dict[str, Any] = {
        "cell_id": cell.id,
        "stage": stage,
        "status": "missing" if record is None else record.status,
        "agent": cell.agent,
        "task": cell.task,
        "source_task": source.task if source else None,
        "source": source.kind if source else "none",
        "source_cell": source.cell_id if source else None,
        "seed": cell.seed,
        "group": cell.group,
        "auc": None,
        "error": record.error if record else None,
        "seconds": record.seconds if record else None,
        "hyperparameters": json.dumps(cell.hyperparameters, sort_keys=True),
    }
    if record is None or record.status != "done":
        return row
    returns: list[Any] = record.points["greedy_return"]
    training: list[Any] = [value for value in record.points["training_return"] if value is not None]
    row |= {
        "auc": auc(returns),
        "training_auc": auc(training),
        "initial_return": returns[0],
        "final_return": returns[-1],
        "asymptotic": asymptotic(returns),
        "steps": record.points["step"][-1],
        "steps_per_second": (record.points["step"][-1] or 0) / record.seconds if record.seconds else None,
    }
    extra = set(record.points) - {"episode", "step", "greedy_return", "discounted_return", "training_return", "seconds"}
    return row | {f"final_{name}": record.points[name][-1] for name in sorted(extra)}


def _mtime(path: Path) -> int:
    return path.stat().st_mtime_ns if path.exists() else 0


def _read_json(path: Path) -> dict[str, Any]:
    try:
        data = json.loads(path.read_bytes())
    except (OSError, ValueError) as error:
        raise InputError(f"cannot read {path}: {error}") from None
    if not isinstance(data, dict) or data.get("schema") != 1:
        raise InputError(f"{path} is not of schema 1")
    return data
