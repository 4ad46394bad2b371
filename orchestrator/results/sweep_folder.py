"""The results of one sweep on disk: the truth that statistics, figures and MLflow are drawn from.

SWEEP/sweep.json        the search space, as last run
SWEEP/plan.json         every cell that it asks for, by stage
SWEEP/records/N.jsonl   the records of ended cells, appended as they end
SWEEP/cells.parquet     one row per planned cell             } written from the above after each run;
SWEEP/points.parquet    one row per cell and evaluation point } SWEEP/tables.json has their digests
Each has a checksum, or is drawn anew from those that have.
"""

from __future__ import annotations

import hashlib
import json
import re
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from orchestrator import clock
from orchestrator.planning.arms import PLAIN, Label, configuration_id
from orchestrator.results import checked_json, plugin_notes
from orchestrator.results.checked_json import DamagedError, damaged, digest
from orchestrator.results.provenance import commit, versions
from orchestrator.results.records.record import Head, Record
from orchestrator.results.records.record_log import RecordLog
from search_spaces.loading import parse
from search_spaces.search_space import SearchSpace
from trainables.cell import Cell
from trainables.errors import InputError, shown, unknown
from trainables.storage.folders import absolute, make_folder
from trainables.storage.paths import is_file, storage_path

if TYPE_CHECKING:
    import pandas as pd

NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9_.-]{0,63}")

SWEEP, PLAN = "sweep.json", "plan.json"
"""The search space and what else a sweep is; the cells that it asks for."""

CELLS, POINTS, TABLES = "cells.parquet", "points.parquet", "tables.json"
"""The tables, and the file that vouches for them."""

Plan = dict[str, list[Cell]]
"""Stage name to its cells, in order."""
Labels = Mapping[str, Sequence[Label]]
"""Cell id to the labels of the arms that it is of, where they say more than the cell."""


def check_name(name: str) -> str:
    """Return `name`; InputError where no sweep can be called that."""
    if not NAME.fullmatch(name):
        raise InputError(
            "a sweep's name must be letters, digits, dots, dashes and underscores, 64 at most, a letter or digit first "
            f"(got {shown(name)})"
        )
    return name


class Results:
    """One sweep's folder. Make one with `create` or `open`."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.log = RecordLog(folder / "records")
        self._space: tuple[Any, SearchSpace] | None = None
        self.mended: list[str] = []
        """Damaged files that `begin` has written anew, in sentences."""
        plugin_notes.recall(folder)

    @classmethod
    def create(cls, storage: Path, name: str, space: SearchSpace) -> Results:
        """Return the folder of the sweep `name` in `storage`, new or grown by `space`. For one who is its only driver.

        Raises InputError for a bad name, a folder that cannot be written to, or one of another search space.
        """
        results = cls.prepare(storage, name)
        results.begin(space)
        return results

    @classmethod
    def prepare(cls, storage: Path, name: str) -> Results:
        """Return the folder of the sweep `name` in `storage`, made where it is missing; what is in it stays as it is.

        Raises InputError for a bad name, or a folder that cannot be written to.
        """
        return cls(make_folder(storage / check_name(name)))

    def begin(self, space: SearchSpace) -> None:
        """Write down the search space of the run that begins. For the driver alone, who holds the lock.

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
        """Return sweep.json as it was; None where it is missing, or so damaged that it is to be written anew."""
        try:
            return self.meta() if (self.folder / SWEEP).exists() else None
        except DamagedError as error:
            self.mended.append(f"{self.folder / SWEEP} was damaged, and is written anew ({error.why})")
            return None

    def _planned_since(self) -> float | None:
        """Return when the sweep was made, by the plan's copy of it."""
        try:
            return float(checked_json.read(self.folder / PLAN)["created"])
        except (InputError, KeyError, TypeError, ValueError):
            return None

    @classmethod
    def open(cls, storage: Path, sweep: str) -> Results:
        """An existing sweep by its name in `storage`, or by its folder; InputError with the list of what there is."""
        for folder in (storage / sweep, storage_path(sweep)) if sweep.strip() else ():
            if is_file(folder / "sweep.json"):
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
        """Return sweep.json; InputError where it is damaged."""
        path = self.folder / SWEEP
        data = checked_json.read(path)
        kinds = {"created": float | int, "commit": str, "versions": dict, "space": dict}
        wrong = [name for name, kind in kinds.items() if not isinstance(data.get(name), kind)]
        wrong = wrong or [name for name in ("name", "family", "seeds", "agents") if name not in data["space"]]
        if wrong:
            raise damaged(path, f"it lacks or spoils '{wrong[0]}'")
        return data

    def space(self) -> SearchSpace:
        """Return the search space, as last run; checked anew only where sweep.json says another."""
        data = self.meta().get("space")
        if self._space is None or self._space[0] != data:
            self._space = data, parse(str(self.folder / SWEEP), data)
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
        """Write down which cells the sweep asks for now, and what their arms know of them beside what they say.

        For the driver alone.
        """
        self.log.check()
        data: dict[str, Any] = {"schema": 1, "created": self.meta()["created"]}
        data["stages"] = {name: [cell.to_json() for cell in cells] for name, cells in stages.items()}
        data["labels"] = labels or {}
        checked_json.write(self.folder / PLAN, data)

    def plan(self) -> Plan:
        """Return the cells that the sweep asks for, as last planned; InputError where the file is damaged."""
        path = self.folder / PLAN
        if not path.exists():
            if self.heads():
                raise damaged(path, "it is missing")
            return {}
        stages = checked_json.read(path).get("stages")
        if not isinstance(stages, dict) or not all(isinstance(cells, list) for cells in stages.values()):
            raise damaged(path, "it lacks or spoils 'stages'")
        return {name: [Cell.from_json(cell) for cell in cells] for name, cells in stages.items()}

    def labels(self) -> dict[str, Labels]:
        """Return stage to the labels of its cells, as last planned; InputError where the file is damaged."""
        path = self.folder / PLAN
        stages = checked_json.read(path).get("labels", {}) if path.exists() else {}
        try:
            return {
                stage: {cell: [Label(*label) for label in labels] for cell, labels in cells.items()}
                for stage, cells in stages.items()
            }
        except (AttributeError, TypeError) as error:
            raise damaged(path, str(error)) from None

    def rows(self) -> list[dict[str, Any]]:
        """The rows of the cells table: one per planned cell, and per arm for a cell of several."""
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

    def ended(self, plan: Plan | None = None) -> Iterator[tuple[str, Cell, Head | None]]:
        """(stage, cell, the head of its record if it has ended) of every planned cell, each cell once."""
        heads = self.heads()
        seen: set[str] = set()
        for stage, cells in (self.plan() if plan is None else plan).items():
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
        stamp = self._stamp()
        ended = self._draw(self.folder)
        vouched = {name: digest(self.folder / name) for name in (CELLS, POINTS)}
        checked_json.write(self.folder / TABLES, {"schema": 1, "stamp": stamp, "ended": ended, **vouched})
        return self._read_tables(self.folder)

    def tables(self) -> tuple[pd.DataFrame, pd.DataFrame]:
        """Return (cells, points) as last written; drawn up anew where a cell has ended since, or a bit is not right.

        Those of a folder that may only be read are drawn beside it.
        """
        if self._vouched():
            return self._read_tables(self.folder)
        try:
            return self.write_tables()
        except OSError:
            with tempfile.TemporaryDirectory(prefix="deltatune-") as folder:
                self._draw(Path(folder))
                return self._read_tables(Path(folder))

    def damage(self, running: bool = False) -> list[str]:
        """Return what is damaged of the records, in sentences. running: a driver may be in the middle of a line."""
        ended, log = len(self.heads()), self.log
        places = [*log.damaged, *(f"{name}, byte {at}" for name, at in log.torn.items() if not running)]
        found = []
        if places:
            found.append(f"{len(places)} damaged records in {log.folder} ({'; '.join(places[:3])})")
        elif (before := int((self._tables_file() or {}).get("ended", 0))) > ended:
            found.append(f"{before - ended} records are gone from {log.folder}")
        return found

    def _draw(self, folder: Path) -> int:
        """Write the tables into `folder`; the number of cells that have ended, those that are asked for no more too."""
        import pandas as pd

        from orchestrator.results.parquet import write_points, write_table

        cells = pd.DataFrame(self.rows())
        write_points(folder / POINTS, (record for _, _, record in self.records() if record))
        write_table(folder / CELLS, cells)
        return len(self.log.heads())

    def _read_tables(self, folder: Path) -> tuple[pd.DataFrame, pd.DataFrame]:
        from orchestrator.results.parquet import read_table

        return read_table(folder / CELLS), read_table(folder / POINTS)

    def _tables_file(self) -> dict[str, Any] | None:
        """Return what vouches for the tables; None where it is missing or damaged: they are drawn anew."""
        try:
            return checked_json.read(self.folder / TABLES)
        except InputError:
            return None

    def _vouched(self) -> bool:
        """Return whether the tables are what was last written, from what there is now."""
        file = self._tables_file()
        if file is None or file.get("stamp") != self._stamp():
            return False
        return all(file.get(name) == digest(self.folder / name) for name in (CELLS, POINTS))

    def _stamp(self) -> str:
        """Return a text that changes whenever what the tables are drawn from does."""
        path = self.folder / PLAN
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
