"""The results of one sweep on disk: the truth that statistics, figures and MLflow are drawn from.

SWEEP/sweep.json        the search space, as last run
SWEEP/plan.json         every cell that it asks for, by stage
SWEEP/records/N.jsonl   the records of ended cells, appended as they end
SWEEP/cells.parquet     one row per planned cell             } written from the above
SWEEP/points.parquet    one row per cell and evaluation point } after each run
"""

from __future__ import annotations

import hashlib
import json
import re
import shlex
import time
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from orchestrator.planning.arms import PLAIN, Label, configuration_id
from orchestrator.results import plugin_notes
from orchestrator.results.provenance import commit, versions
from orchestrator.results.record import Head, Record
from orchestrator.results.record_log import RecordLog
from search_spaces.loading import parse
from search_spaces.search_space import SearchSpace
from trainables.cell import Cell
from trainables.errors import InputError, unknown
from trainables.storage.atomic import write_atomic
from trainables.storage.folders import absolute, make_folder
from trainables.storage.paths import storage_path

if TYPE_CHECKING:
    import pandas as pd

NAME = re.compile(r"^[A-Za-z0-9][A-Za-z0-9_.-]{0,63}$")

CELLS, POINTS = "cells.parquet", "points.parquet"
"""The tables."""

Plan = dict[str, list[Cell]]
"""Stage name to its cells, in order."""
Labels = Mapping[str, Sequence[Label]]
"""Cell id to the labels of the arms that it is of, where they say more than the cell."""


class Results:
    """One sweep's folder. Make one with `create` or `open`."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.log = RecordLog(folder / "records")
        self._space: tuple[Any, SearchSpace] | None = None
        plugin_notes.recall(folder)

    @classmethod
    def create(cls, storage: Path, name: str, space: SearchSpace) -> Results:
        """The folder of the sweep `name` in `storage`, new or grown by `space`.

        Raises InputError for a bad name, a folder that cannot be written to, or one of another search space.
        """
        if not NAME.match(name):
            raise InputError(f"a sweep's name must be letters, digits, dots, dashes and underscores (got '{name}')")
        results = cls(make_folder(storage / name))
        make_folder(results.log.folder)
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
        plugin_notes.keep(results.folder, space)
        return results

    @classmethod
    def open(cls, storage: Path, sweep: str) -> Results:
        """An existing sweep by its name in `storage`, or by its folder; InputError with the list of what there is."""
        for folder in (storage / sweep, storage_path(sweep)):
            if (folder / "sweep.json").is_file():
                return cls(absolute(folder))
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
        """The search space, as last run; checked anew only where sweep.json says another."""
        data = self.meta().get("space")
        if self._space is None or self._space[0] != data:
            self._space = data, parse(str(self.folder / "sweep.json"), data)
        return self._space[1]

    def add(self, *records: Record) -> None:
        """Write the records of ended cells. From here on they are never lost, and never run again if they are done."""
        self.log.append(records)

    def heads(self) -> Mapping[str, Head]:
        """The records as they are on disk now, by cell id, without their curves."""
        self.log.refresh()
        return self.log.heads()

    def record(self, cell_id: str) -> Record | None:
        """The whole record of a cell, None where it has not ended; InputError where its file is damaged."""
        if not re.fullmatch(r"[0-9a-f]{16}", cell_id):
            raise InputError(f"a cell id is 16 hexadecimal digits (got '{cell_id}')")
        self.log.refresh()
        return self.log.record(cell_id)

    def set_plan(self, stages: Plan, labels: Mapping[str, Labels] | None = None) -> None:
        """Write down which cells the sweep asks for now, and what their arms know of them beside what they say."""
        data: dict[str, Any] = {"schema": 1}
        data["stages"] = {name: [cell.to_json() for cell in cells] for name, cells in stages.items()}
        data["labels"] = labels or {}
        write_atomic(self.folder / "plan.json", json.dumps(data, separators=(",", ":")).encode())

    def plan(self) -> Plan:
        """The cells that the sweep asks for, as last planned."""
        path = self.folder / "plan.json"
        if not path.exists():
            return {}
        stages = _read_json(path)["stages"]
        return {name: [Cell.from_json(cell) for cell in cells] for name, cells in stages.items()}

    def labels(self) -> dict[str, Labels]:
        """Stage to the labels of its cells, as last planned."""
        path = self.folder / "plan.json"
        stages = _read_json(path).get("labels", {}) if path.exists() else {}
        return {
            stage: {cell: [Label(*label) for label in labels] for cell, labels in cells.items()}
            for stage, cells in stages.items()
        }

    def rows(self) -> list[dict[str, Any]]:
        """The rows of the cells table: one per planned cell, and per arm for a cell of several."""
        labels, heads = self.labels(), self.heads()
        found: dict[tuple[str, Label], dict[str, Any]] = {}
        for stage, cells in self.plan().items():
            for cell in cells:
                for label in labels.get(stage, {}).get(cell.id, [PLAIN]):
                    if (cell.id, label) not in found:
                        found[cell.id, label] = cell_row(stage, cell, heads.get(cell.id), label)
        return list(found.values())

    def ended(self) -> Iterator[tuple[str, Cell, Head | None]]:
        """(stage, cell, the head of its record if it has ended) of every planned cell, each cell once."""
        heads = self.heads()
        seen: set[str] = set()
        for stage, cells in self.plan().items():
            for cell in cells:
                if cell.id not in seen:
                    seen.add(cell.id)
                    yield stage, cell, heads.get(cell.id)

    def records(self) -> Iterator[tuple[str, Cell, Record | None]]:
        """As `ended`, with whole records, each read when it is asked for."""
        for stage, cell, head in self.ended():
            yield stage, cell, self.log.record(cell.id) if head else None

    def write_tables(self) -> tuple[pd.DataFrame, pd.DataFrame]:
        """Draw the two tables up from the records, write them as Parquet, and return (cells, points)."""
        import pandas as pd

        from orchestrator.results.parquet import read_table, write_points, write_table

        stamp = self._stamp()
        cells = pd.DataFrame(self.rows())
        write_points(self.folder / POINTS, (record for _, _, record in self.records() if record), stamp)
        write_table(self.folder / CELLS, cells, stamp)
        return cells, read_table(self.folder / POINTS)

    def tables(self) -> tuple[pd.DataFrame, pd.DataFrame]:
        """(cells, points) as last written; drawn up anew where a cell has ended since."""
        from orchestrator.results.parquet import read_table, table_stamp

        stamp = self._stamp()
        if all(table_stamp(self.folder / name) == stamp for name in (CELLS, POINTS)):
            return read_table(self.folder / CELLS), read_table(self.folder / POINTS)
        return self.write_tables()

    def _stamp(self) -> str:
        """Changes whenever what the tables are drawn from does."""
        path = self.folder / "plan.json"
        plan = hashlib.sha256(path.read_bytes()).hexdigest() if path.exists() else ""
        return f"{plan};{self.log.stamp()}"


def cell_row(stage: str, cell: Cell, head: Head | None, label: Label = PLAIN) -> dict[str, Any]:
    """A cell's row of the cells table. A cell that is not done has no AUC: it is counted, never averaged."""
    source = cell.sources[0] if cell.sources else None
    row: dict[str, Any] = {
        "cell_id": cell.id,
        "stage": stage,
        "status": "missing" if head is None else head.status,
        "agent": cell.agent,
        "task": cell.task,
        "source_task": source.task if source else None,
        "source": source.kind if source else "none",
        "source_cell": source.cell_id if source else None,
        "pick": label.pick or None,
        "baseline_for": label.baseline_for or None,
        "seed": cell.seed,
        "group": configuration_id(cell, label),
        "auc": None,
        "error": head.error if head else None,
        "seconds": head.seconds if head else None,
        "hyperparameters": json.dumps(cell.hyperparameters, sort_keys=True),
    }
    return row | (head.summary if head else {})


def _read_json(path: Path) -> dict[str, Any]:
    try:
        data = json.loads(path.read_bytes())
    except (OSError, ValueError) as error:
        raise InputError(f"cannot read {path}: {error}") from None
    if not isinstance(data, dict) or data.get("schema") != 1:
        raise InputError(f"{path} is not of schema 1")
    return data


NAMES = "given.json"
"""The file of a sweep's folder that says which sources it was given last."""


def options(results: Results) -> str:
    """The options that give a sweep the same sources again."""
    path = results.folder / NAMES
    names: list[str] = json.loads(path.read_bytes()) if path.exists() else []
    return "".join(f" --source {shlex.quote(name)}" for name in names)
