"""The source library: trained source knowledge by the id of the cell that trained it, in STORAGE/sources."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from orchestrator.results.records.record import Record, read_record, split_line
from trainables.agents.registry import agent_named
from trainables.cell import Cell
from trainables.errors import InputError, unknown
from trainables.knowledge import Knowledge
from trainables.knowledge_check import check_fit
from trainables.storage.atomic import write_atomic
from trainables.storage.folders import make_folder
from trainables.storage.paths import is_local, read_range
from trainables.tasks.registry import parse_task


@dataclass(frozen=True)
class Entry:
    """One source of the library, its checksum verified."""

    cell: Cell
    knowledge: Knowledge
    record: Record | None
    """The record of the cell that trained it; None where the file was written without one."""
    size: int
    """Bytes of the file."""

    @property
    def id(self) -> str:
        """The id of its cell."""
        return self.cell.id

    @property
    def best_return(self) -> float | None:
        """Its best greedy evaluation."""
        return max(self.record.returns) if self.record else None

    @property
    def final_return(self) -> float | None:
        """Its last greedy evaluation."""
        return self.record.returns[-1] if self.record else None


def read_entry(data: bytes, where: str) -> Entry:
    """Return the source in the bytes of a library file.

    Raises InputError, which starts with `where`, for a damaged file, one that is no source, or does not fit its task.
    """
    try:
        return _entry(data)
    except InputError as error:
        raise InputError(f"{where} is damaged ({error})") from None


def _entry(data: bytes) -> Entry:
    knowledge, meta = Knowledge.from_bytes(data)
    cell = Cell.from_json(meta.get("cell"))
    record = None
    if meta.get("record") is not None:
        line = split_line(str(meta["record"]).encode())
        if line is None:
            raise InputError("its record does not agree with its checksum")
        record = read_record(line)
        if record.cell != cell:
            raise InputError(f"its record is of another cell, {record.cell.id}")
    if parse_task(cell.task).family.origin != "missing":
        check_fit(cell, knowledge)
    return Entry(cell, knowledge, record, len(data))


class SourceLibrary:
    """A folder of .npz files without pickle; each is verified against its checksum when it is read."""

    def __init__(self, storage: Path) -> None:
        self._folder = storage / "sources"
        self._made = False
        self._listed: set[str] | None = None
        """The ids on an object store, listed with one request, and those saved since."""

    def save(self, cell: Cell, knowledge: Knowledge, record: Record | None = None) -> None:
        """Save the knowledge of `cell`, with its record, so that a later sweep can use it without training."""
        meta: dict[str, Any] = {"cell": cell.to_json()}
        if record is not None:
            meta["record"] = record.to_line().decode()
        self._put(cell.id, knowledge.to_bytes(meta))

    def _put(self, cell_id: str, data: bytes) -> None:
        if not self._made:
            make_folder(self._folder)
            self._made = True
        write_atomic(self.path(cell_id), data)
        if self._listed is not None:
            self._listed.add(cell_id)

    def add(self, data: bytes, where: str) -> Entry:
        """Add the file `data`; an equal one that exists stays.

        Raises InputError, which starts with `where`, for a damaged file, and where a different file of the cell exists.
        """
        entry = read_entry(data, where)
        if self.has(entry.id):
            if self.entry(entry.id).knowledge.digest != entry.knowledge.digest:
                raise InputError(f"{where}: the library has another source {entry.id}; remove that one first")
            return entry
        self._put(entry.id, data)
        return entry

    def remove(self, cell_id: str) -> None:
        """Delete a source. Raises InputError where there is none."""
        if not self.has(cell_id):
            raise unknown("source", cell_id, self.ids())
        self.path(cell_id).unlink()
        self._listed = None

    def ids(self) -> list[str]:
        """Return the ids of all sources, sorted."""
        return sorted(path.stem for path in self._folder.glob("*.npz") if re.fullmatch(r"[0-9a-f]{16}", path.stem))

    def entries(self) -> Iterator[Entry]:
        """Yield all sources. Raises InputError at the first that is damaged."""
        for cell_id in self.ids():
            yield self.entry(cell_id)

    def has(self, cell_id: str) -> bool:
        """Return whether the library has the cell's knowledge."""
        path = self.path(cell_id)
        if is_local(path):
            return path.exists()
        if self._listed is None:
            self._listed = set(self.ids())
        return cell_id in self._listed

    def damage(self, cell_id: str) -> str:
        """Return what is wrong with a source, or ''. Objects of an object store are taken as intact."""
        if not self.has(cell_id) or not is_local(self._folder):
            return ""
        try:
            self.entry(cell_id)
        except InputError as error:
            return str(error)
        return ""

    def entry(self, cell_id: str) -> Entry:
        """Return the source of a cell. Raises InputError where it is missing, damaged or another cell's."""
        path = self.path(cell_id)
        try:
            entry = _entry(read_range(path))
        except FileNotFoundError:
            raise InputError(f"the source library has no {path.name} (looked in {self._folder})") from None
        except InputError as error:
            raise InputError(f"{path} is damaged ({error}): move it away and run the sweep again") from None
        if entry.id != cell_id:
            raise InputError(
                f"{path} holds the knowledge of another cell, {entry.id}: move it away and run the sweep again"
            )
        return entry

    def load(self, cell_id: str) -> Knowledge:
        """Return the knowledge of a cell. Raises InputError as `entry` does."""
        return self.entry(cell_id).knowledge

    def record(self, cell_id: str) -> Record | None:
        """Return the record of the cell that trained a source, or None."""
        return self.entry(cell_id).record if self.has(cell_id) else None

    def find(self, names: list[str]) -> list[Entry]:
        """Return the sources with these ids, prefixes of ids, or tasks (none: all). Raises InputError for no match."""
        entries = list(self.entries())
        if not names:
            return entries
        chosen: dict[str, Entry] = {}
        for name in names:
            found = [entry for entry in entries if entry.id.startswith(name) or entry.cell.task == _task(name)]
            if not found:
                raise unknown("source", name, sorted({entry.cell.task for entry in entries}))
            chosen |= {entry.id: entry for entry in found}
        return list(chosen.values())

    def path(self, cell_id: str) -> Path:
        """Return the file of a cell's knowledge."""
        if not re.fullmatch(r"[0-9a-f]{16}", cell_id):
            raise InputError(f"a cell id is 16 hexadecimal digits (got '{cell_id}')")
        return self._folder / f"{cell_id}.npz"


def _task(name: str) -> str | None:
    """Return the canonical name if `name` is a task, else None."""
    try:
        return parse_task(name).name
    except InputError:
        return None


def row(entry: Entry) -> dict[str, Any]:
    """Return a source as plain data, for a table."""
    record = entry.record
    return {
        "id": entry.id,
        "task": entry.cell.task,
        "agent": entry.cell.agent,
        "kind": agent_named(entry.cell.agent).kind,
        "seed": entry.cell.seed,
        "episodes": entry.cell.episodes,
        "learning_rate": entry.cell.hyperparameters["learning_rate"],
        "best_return": entry.best_return,
        "final_return": entry.final_return,
        "versions": dict(record.versions) if record else {},
        "finished": record.finished if record else None,
        "bytes": entry.size,
        "digest": entry.knowledge.digest,
    }
