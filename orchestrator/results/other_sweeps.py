"""Cells that other sweeps of a storage folder have finished, so that a new sweep can copy them."""

from __future__ import annotations

import logging
from collections.abc import Iterator, Mapping
from pathlib import Path

from orchestrator.results.provenance import versions
from orchestrator.results.records.record import Line, Record, id_on, read_record, split_line
from orchestrator.results.records.record_log import SEGMENT
from trainables.agents.registry import agent_named
from trainables.cell import Cell
from trainables.errors import InputError
from trainables.storage.paths import is_local, read_range, sizes
from trainables.tasks.registry import parse_task

DECISIVE = ("python", "gymnasium", "numpy", "scipy", "numba", "torch")
"""Packages whose versions must agree: a record of other ones is not copied."""

log = logging.getLogger("deltatune.sweep")

_Place = tuple[Path, int, int]


class OtherSweeps:
    """The finished cells of all sweeps in a storage folder but one. Reading takes no lock and changes nothing.

    Only for a folder on a disk: on an object store every record may be an object of its own.
    """

    def __init__(self, storage: Path, but: str) -> None:
        """but: the name of the sweep that asks."""
        self._storage, self._but = storage, but
        self._known: dict[str, list[_Place]] | None = None

    def find(self, cell: Cell) -> tuple[str, Record] | None:
        """Return a sweep's name and its record of a done cell, the latest one; None where none can be copied.

        Cells of custom code and of Gymnasium's registry are never copied: their ids do not cover all of that code.
        """
        if not (places := self._places().get(cell.id)) or not built_in(cell):
            return None
        found: tuple[str, Record] | None = None
        for name, line in _lines(places):
            record = _readable(name, line)
            if record is not None and record.status == "done" and same_versions(record.versions):
                found = max(found or (name, record), (name, record), key=lambda each: each[1].finished)
        return found

    def _places(self) -> dict[str, list[_Place]]:
        """Return where the lines of each cell are, read once."""
        if self._known is None:
            self._known = {}
            local = is_local(self._storage)
            for path in sorted(self._storage.glob("*/sweep.json")) if local else ():
                if path.parent.name != self._but:
                    self._index(path.parent / "records", self._known)
        return self._known

    def _index(self, folder: Path, known: dict[str, list[_Place]]) -> None:
        """Add the lines of a sweep's records, without parsing them. What another driver replaces meanwhile is left."""
        try:
            for name in filter(SEGMENT.fullmatch, sorted(sizes(folder))):
                offset = 0
                with (folder / name).open("rb") as file:
                    for line in file:
                        known.setdefault(id_on(line), []).append((folder / name, offset, offset + len(line)))
                        offset += len(line)
        except OSError as error:
            log.info("%s is left out of what can be copied: %s", folder.parent, error)


def built_in(cell: Cell) -> bool:
    """Return whether everything that decides a cell's result is in its id and in deltatune's own code."""
    tasks = [parse_task(name) for name in (cell.task, *(source.task for source in cell.sources))]
    return agent_named(cell.agent).origin == "built-in" and all(
        task.family.origin == "built-in" and not task.name.startswith("gym:") for task in tasks
    )


def _lines(places: list[_Place]) -> Iterator[tuple[str, Line]]:
    """Yield (sweep, line) for the places that can still be read and whose checksum is right."""
    for path, start, stop in places:
        try:
            line = split_line(read_range(path, start, stop))
        except OSError:
            continue
        if line is not None:
            yield path.parent.parent.name, line


def _readable(name: str, line: Line) -> Record | None:
    try:
        return read_record(line)
    except InputError as error:
        log.warning("the sweep %s: %s: the cell is trained here", name, error)
        return None


def same_versions(before: Mapping[str, str]) -> bool:
    """Return whether the packages that decide a cell's bits have the versions of a record."""
    now = versions()
    return all(before.get(name, now.get(name)) == now.get(name) for name in DECISIVE)
