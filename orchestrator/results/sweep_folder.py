"""The results of one sweep on disk, from which statistics, figures and MLflow's copy are made.

SWEEP/sweep.json        the search space, as last run
SWEEP/plan.json         every cell that it asks for, by stage (see `records.plan_file`)
SWEEP/records/N.jsonl   the records of ended cells, appended as they end
SWEEP/cells.parquet     one row per planned cell             } built from the above after each run;
SWEEP/points.parquet    one row per cell and evaluation point } SWEEP/tables.json has their digests
Each has a checksum, or can be rebuilt from those that have.
"""

from __future__ import annotations

import hashlib
import re
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from orchestrator import clock
from orchestrator.planning.arms import PLAIN, Label
from orchestrator.results import checked_json, plugin_notes
from orchestrator.results.checked_json import DamagedError, damaged
from orchestrator.results.lock import Hold
from orchestrator.results.provenance import commit, versions
from orchestrator.results.records.plan_file import PlanFile
from orchestrator.results.records.record import Head, Record
from orchestrator.results.records.record_log import RecordLog
from orchestrator.results.tables.cell_row import cell_row
from orchestrator.results.tables.table_files import TableFiles
from search_spaces.loading import parse
from search_spaces.search_space import SearchSpace
from trainables.cell import Cell
from trainables.errors import InputError, shown, unknown
from trainables.storage.folders import absolute, make_folder
from trainables.storage.paths import is_file, read_range, storage_path

if TYPE_CHECKING:
    import pandas as pd

NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9_.-]{0,63}")

TAKEN = frozenset({"sources", "mlartifacts", "mlflow.db"})
"""Names, in small letters, that a storage folder has for what is no sweep: the source library, and MLflow's files."""

SWEEP = "sweep.json"
"""The search space with the origin of the sweep."""

Plan = dict[str, list[Cell]]
"""Stage name to its cells, in order."""
Labels = Mapping[str, Sequence[Label]]
"""Cell id to the labels of its arms, where they say more than the cell."""


def check_name(name: str) -> str:
    """Return `name`. Raises InputError where it is not a valid name of a sweep, or taken by other files."""
    if not NAME.fullmatch(name):
        raise InputError(
            "a sweep's name must be letters, digits, dots, dashes and underscores, 64 at most, a letter or digit first "
            f"(got {shown(name)})"
        )
    if name.lower() in TAKEN:  # some file systems ignore the case
        raise InputError(f"a sweep cannot be named {shown(name)}: its storage folder has that name for other files")
    return name


class Results:
    """One sweep's folder. Make one with `create` or `open`."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.log, self._plan = RecordLog(folder / "records"), PlanFile(folder)
        self._space: tuple[Any, SearchSpace] | None = None
        self._tables = TableFiles(folder, self._stamp, self.rows, self._ended_records, lambda: len(self.log.heads()))
        self.repaired: list[str] = []
        """Damaged files that `begin` has written again, in sentences."""
        plugin_notes.recall(folder)

    @classmethod
    def create(cls, storage: Path, name: str, space: SearchSpace) -> Results:
        """Return the folder of the sweep `name` in `storage`, new or extended by `space`. Only for its driver.

        Raises InputError for a bad name, a folder that cannot be written to, or one of another search space.
        """
        results = cls.prepare(storage, name)
        results.begin(space)
        return results

    @classmethod
    def prepare(cls, storage: Path, name: str) -> Results:
        """Return the folder of the sweep `name` in `storage`, created where it is missing, else unchanged.

        Raises InputError for a bad name, or a folder that cannot be written to.
        """
        return cls(make_folder(storage / check_name(name)))

    def guard(self, hold: Hold) -> None:
        """Write records and plan only while `hold` is valid."""
        self.log.guard(hold)
        self._plan.guard(hold)

    def begin(self, space: SearchSpace) -> None:
        """Write the search space of a new run. Only for the driver, which holds the lock.

        Raises InputError where the folder belongs to another search space.
        """
        make_folder(self.log.folder)
        before = self._before()
        if before and before["space"]["name"] != space.name:
            other = before["space"]["name"]
            raise InputError(f"the sweep '{self.name}' belongs to the search space '{other}': choose another --name")
        created = before["created"] if before else self._planned_since() or clock.time()
        meta = {"schema": 1, "name": self.name, "created": created, "space": space.to_json()}
        checked_json.write(self.folder / SWEEP, meta | {"commit": commit(), "versions": versions()}, indent=1)
        plugin_notes.keep(self.folder, space)

    def _before(self) -> dict[str, Any] | None:
        """Return the present sweep.json; None where it is missing or damaged and has to be written again."""
        try:
            return self.meta() if (self.folder / SWEEP).exists() else None
        except DamagedError as error:
            self.repaired.append(f"{self.folder / SWEEP} was damaged, and is written again ({error.why})")
            return None

    def _planned_since(self) -> float | None:
        """Return when the sweep was created, from the copy in the plan."""
        try:
            return float(checked_json.read(self._plan.path())["created"])
        except (InputError, KeyError, TypeError, ValueError):
            return None

    @classmethod
    def open(cls, storage: Path, sweep: str) -> Results:
        """Return the sweep of this name in `storage`, or in this folder. Raises InputError, with a list, for others."""
        for folder in (storage / sweep, storage_path(sweep)) if sweep.strip() else ():
            if is_file(folder / "sweep.json"):
                return cls(absolute(folder))
        there = sorted(path.parent.name for path in storage.glob("*/sweep.json"))
        raise unknown(f"sweep in {storage}", sweep, there)

    @property
    def name(self) -> str:
        """The sweep's name, which is that of its folder."""
        return self.folder.name

    @property
    def storage(self) -> Path:
        """The folder of all sweeps, with the source library and MLflow's store."""
        return self.folder.parent

    def meta(self) -> dict[str, Any]:
        """Return sweep.json. Raises InputError where it is damaged."""
        path = self.folder / SWEEP
        data = checked_json.read(path)
        kinds = {"created": float | int, "commit": str, "versions": dict, "space": dict}
        wrong = [name for name, kind in kinds.items() if not isinstance(data.get(name), kind)]
        wrong = wrong or [name for name in ("name", "family", "seeds", "agents") if name not in data["space"]]
        if wrong:
            raise damaged(path, f"'{wrong[0]}' is missing or wrong")
        return data

    def space(self) -> SearchSpace:
        """Return the search space of the last run; it is validated again only where sweep.json has changed."""
        data = self.meta().get("space")
        if self._space is None or self._space[0] != data:
            self._space = data, parse(str(self.folder / SWEEP), data)
        return self._space[1]

    def add(self, *records: Record) -> None:
        """Write the records of ended cells durably; those that are done never run again."""
        self.log.append(records)

    def heads(self) -> Mapping[str, Head]:
        """Return the present records by cell id, without their curves."""
        self.log.refresh()
        return self.log.heads()

    def record(self, cell_id: str) -> Record | None:
        """Return the whole record of a cell, or None. Raises InputError where its file is damaged."""
        if not re.fullmatch(r"[0-9a-f]{16}", cell_id):
            raise InputError(f"a cell id is 16 hexadecimal digits (got '{cell_id}')")
        self.log.refresh()
        return self.log.record(cell_id)

    def set_plan(self, stages: Plan, labels: Mapping[str, Labels] | None = None) -> None:
        """Write the cells that the sweep asks for now, and the labels of their arms. Only for the driver."""
        data: dict[str, Any] = {"schema": 1, "created": self.meta()["created"]}
        data["stages"] = {name: [cell.to_json() for cell in cells] for name, cells in stages.items()}
        data["labels"] = labels or {}
        self._plan.write(data)

    def plan(self) -> Plan:
        """Return the cells of the last plan. Raises InputError where the file is damaged."""
        path = self._plan.path()
        if not path.exists():
            if self.heads():
                raise damaged(path, "it is missing")
            return {}
        stages = checked_json.read(path).get("stages")
        if not isinstance(stages, dict) or not all(isinstance(cells, list) for cells in stages.values()):
            raise damaged(path, "'stages' is missing or wrong")
        return {name: [Cell.from_json(cell) for cell in cells] for name, cells in stages.items()}

    def labels(self) -> dict[str, Labels]:
        """Return stage to the labels of its cells in the last plan. Raises InputError where the file is damaged."""
        path = self._plan.path()
        stages = checked_json.read(path).get("labels", {}) if path.exists() else {}
        try:
            return {
                stage: {cell: [Label(*label) for label in labels] for cell, labels in cells.items()}
                for stage, cells in stages.items()
            }
        except (AttributeError, TypeError) as error:
            raise damaged(path, str(error)) from None

    def rows(self) -> list[dict[str, Any]]:
        """Return the rows of the cells table: one per planned cell, and one per arm for a cell of several arms."""
        labels, heads, plan = self.labels(), self.heads(), self.plan()
        seeds = {cell.id: cell.seed for cells in plan.values() for cell in cells}
        found: dict[tuple[str, Label], dict[str, Any]] = {}
        for stage, cells in plan.items():
            for cell in cells:
                for label in labels.get(stage, {}).get(cell.id, [PLAIN]):
                    if (cell.id, label) not in found:
                        row = cell_row(stage, cell, heads.get(cell.id), label)
                        found[cell.id, label] = row | {"source_seed": seeds.get(row["source_cell"])}
        return list(found.values())

    def planned_heads(self, plan: Plan | None = None) -> Iterator[tuple[str, Cell, Head | None]]:
        """Yield (stage, cell, the head of its record or None) for every planned cell, each cell once."""
        heads = self.heads()
        seen: set[str] = set()
        for stage, cells in (self.plan() if plan is None else plan).items():
            for cell in cells:
                if cell.id not in seen:
                    seen.add(cell.id)
                    yield stage, cell, heads.get(cell.id)

    def records(self) -> Iterator[tuple[str, Cell, Record | None]]:
        """Yield the same as `planned_heads` with whole records, each read on demand."""
        for stage, cell, head in self.planned_heads():
            yield stage, cell, self.log.record(cell.id) if head else None

    def _ended_records(self) -> Iterator[Record]:
        return (record for _, _, record in self.records() if record)

    def write_tables(self) -> tuple[pd.DataFrame, pd.DataFrame]:
        """Build both tables from the records, write them as Parquet, and return (cells, points)."""
        return self._tables.write()

    def tables(self) -> tuple[pd.DataFrame, pd.DataFrame]:
        """Return (cells, points), rebuilt where a cell has ended since they were written, or a file is damaged."""
        return self._tables.read()

    def damage(self, running: bool = False) -> list[str]:
        """Return the damage of the records, in sentences. running: a driver may be in the middle of a line."""
        ended, log = len(self.heads()), self.log
        places = [*log.damaged, *(f"{name}, byte {at}" for name, at in log.torn.items() if not running)]
        found = []
        if places:
            found.append(f"{len(places)} damaged records in {log.folder} ({'; '.join(places[:3])})")
        elif (before := self._tables.ended_before()) > ended:
            found.append(f"{before - ended} records are gone from {log.folder}")
        return found

    def _stamp(self) -> str:
        """Return a text that changes with the data from which the tables are built."""
        path = self._plan.path()
        plan = hashlib.sha256(read_range(path)).hexdigest() if path.exists() else ""
        return f"{plan};{self.log.stamp()}"
