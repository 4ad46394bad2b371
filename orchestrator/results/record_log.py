"""The records of a sweep as an append-only log in segments: one writer, any number of readers, no record rewritten.

A segment is a file of lines, one record each (see `record.Record.to_line`). Each run of a sweep appends to a segment
of its own; on an object store, which cannot append, each call of `append` makes one. The last line of a cell counts.
A line that a crash has cut off, or a disk has damaged, fails its checksum: its cell has not ended, and runs again.
"""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from orchestrator.results.record import Head, Record, read_head, read_record, split_line
from trainables.storage.atomic import sync_folder, write_atomic
from trainables.storage.paths import is_local

SEGMENT_BYTES = 64 * 2**20
"""Length at which a segment is closed."""

MANY = 16
"""Segments from which on `compact` merges them."""


@dataclass(frozen=True)
class _Place:
    segment: str
    offset: int
    length: int


@dataclass
class RecordLog:
    """The log in `folder`. Reading never changes it; only the driver of the sweep appends."""

    folder: Path
    damaged: list[str] = field(default_factory=list)
    """'SEGMENT, byte N' of each damaged line seen."""
    _heads: dict[str, Head] = field(default_factory=dict)
    _places: dict[str, _Place] = field(default_factory=dict)
    _read: dict[str, int] = field(default_factory=dict)
    """Bytes of each segment that are in the index."""
    _lines: int = 0
    _segment: Path | None = None

    def refresh(self) -> None:
        """Take in what has been appended since the last call."""
        try:
            self._scan()
        except FileNotFoundError:
            self._rescan()

    def heads(self) -> dict[str, Head]:
        """The records without their curves, by cell id, as of the last `refresh` or `append`."""
        return self._heads

    def record(self, cell_id: str) -> Record | None:
        """The whole record of a cell, None where it has not ended; InputError where it cannot be read."""
        for _ in range(2):
            place = self._places.get(cell_id)
            if place is None:
                return None
            try:
                line = split_line(self._bytes(place))
            except FileNotFoundError:
                line = None
            if line is not None and line.cell_id == cell_id:
                return read_record(line)
            self._rescan()
        return None

    def append(self, records: Sequence[Record]) -> None:
        """Write records to disk; when this returns they are there for good. OSError where the disk refuses them."""
        lines = [record.to_line() for record in records]
        data = b"".join(lines)
        segment, start = self._put(data)
        for record, line in zip(records, lines, strict=True):
            self._index(record.cell.id, record.head, _Place(segment, start, len(line)))
            start += len(line)
        self._read[segment] = start

    def compact(self) -> None:
        """Merge many segments into few, without the lines that later ones have replaced. For the driver alone."""
        old = self._segments()
        if len(old) <= MANY and self._lines <= 2 * len(self._places):
            return
        self._segment = None
        batch, size, number = [], 0, int(old[-1].stem) + 1
        for place in list(self._places.values()):
            batch.append(self._bytes(place))
            size += place.length
            if size >= SEGMENT_BYTES:
                write_atomic(self.folder / f"{number:06d}.jsonl", b"".join(batch))
                batch, size, number = [], 0, number + 1
        if batch:
            write_atomic(self.folder / f"{number:06d}.jsonl", b"".join(batch))
        for path in old:
            path.unlink(missing_ok=True)
        self._rescan()

    def stamp(self) -> str:
        """Changes whenever the log does."""
        return ",".join(f"{path.name}:{path.stat().st_size}" for path in self._segments())

    def _put(self, data: bytes) -> tuple[str, int]:
        """Append to this run's segment: (its name, the offset of `data`)."""
        if not is_local(self.folder):
            path = self._next()
            write_atomic(path, data)
            return path.name, 0
        if self._segment is None or self._segment.stat().st_size >= SEGMENT_BYTES:
            self._segment = self._next()
        with open(self._segment, "ab") as file:
            start = file.tell()
            try:
                file.write(data)
                file.flush()
                os.fsync(file.fileno())
            except OSError:
                os.truncate(self._segment, start)
                raise
        if not start:
            sync_folder(self.folder)
        return self._segment.name, start

    def _next(self) -> Path:
        there = self._segments()
        return self.folder / f"{int(there[-1].stem) + 1 if there else 0:06d}.jsonl"

    def _segments(self) -> list[Path]:
        return sorted(self.folder.glob("[0-9]*.jsonl"), key=lambda path: path.name)

    def _scan(self) -> None:
        for path in self._segments():
            start = self._read.get(path.name, 0)
            if path.stat().st_size <= start:
                continue
            for offset, data in _lines(path, start):
                self._read[path.name] = offset + len(data)
                line = split_line(data)
                if line is None:
                    self.damaged.append(f"{path.name}, byte {offset}")
                else:
                    self._index(line.cell_id, read_head(line), _Place(path.name, offset, len(data)))

    def _rescan(self) -> None:
        """Read the log anew: its driver has compacted it."""
        for part in (self._heads, self._places, self._read, self.damaged):
            part.clear()
        self._lines = 0
        self._scan()

    def _index(self, cell_id: str, head: Head, place: _Place) -> None:
        self._heads[cell_id] = head
        self._places[cell_id] = place
        self._lines += 1

    def _bytes(self, place: _Place) -> bytes:
        with (self.folder / place.segment).open("rb") as file:
            file.seek(place.offset)
            return file.read(place.length)


def _lines(path: Path, start: int) -> Iterator[tuple[int, bytes]]:
    """(offset, line) of the whole lines from `start` on; the end of a segment that is being written is left out."""
    with path.open("rb") as file:
        file.seek(start)
        offset = start
        for line in file:
            if line.endswith(b"\n"):
                yield offset, line
            offset += len(line)
