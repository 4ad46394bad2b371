"""The records of a sweep as an append-only log in segments, with one writer and any number of readers.

A segment is a file of lines, one record each (see `record.Record.to_line`). Each run of a sweep appends to a new
segment; on an object store, which cannot append, each call of `append` writes one, with the token of the driver's lease
in its name: a driver that has lost its lease cannot overwrite the records of the present one. The last line of a cell
counts. A line that a crash has cut off or a disk has damaged fails its checksum; its cell then counts as not ended, and
runs again.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from orchestrator.results.lock import Hold
from orchestrator.results.records.record import Head, Record, read_head, read_record, split_line
from trainables.storage import disk
from trainables.storage.atomic import append, write_atomic
from trainables.storage.paths import is_local, read_range, sizes

SEGMENT_BYTES = 64 * 2**20
"""Size at which a segment is closed."""

MAX_SEGMENTS = 16
"""With more segments than this, `compact` merges them."""

SEGMENT = re.compile(r"(\d+)(-[0-9a-f]+)?\.jsonl")
"""The name of a segment: its number, and on an object store the token of its writer's lease."""


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
    torn: dict[str, int] = field(default_factory=dict)
    """Segment to the offset of an unfinished line at its end."""
    takeovers: int = 0
    """How many earlier writers may each still write one segment: this one's numbers are higher than theirs."""
    token: str = ""
    """Part of the names of this writer's segments; empty where the folder's lock cannot be lost."""
    check: Callable[[], None] = lambda: None
    """Called before each write; raises LeaseLostError where this writer is no longer the driver."""
    _heads: dict[str, Head] = field(default_factory=dict)
    _places: dict[str, _Place] = field(default_factory=dict)
    _read: dict[str, int] = field(default_factory=dict)
    """Segment to the number of its bytes in the index."""
    _lines: int = 0
    _segment: Path | None = None
    _number: int | None = None
    """The number of the last segment written."""
    _held: tuple[str, bytes] | None = None
    """The name and content of the last segment read from an object store."""

    def guard(self, hold: Hold) -> None:
        """Write only while `hold` is valid."""
        self.token, self.takeovers, self.check = hold.token, hold.takeovers, hold.check

    def refresh(self) -> None:
        """Read the lines that were appended since the last call."""
        try:
            self._scan()
        except FileNotFoundError:
            self._rescan()

    def heads(self) -> dict[str, Head]:
        """Return the records without their curves, by cell id, as of the last `refresh` or `append`."""
        return self._heads

    def record(self, cell_id: str) -> Record | None:
        """Return the whole record of a cell, or None. Raises InputError where it cannot be read."""
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
        """Write records to disk; they are durable when this returns. Raises OSError where the disk refuses them."""
        self.check()
        lines = [record.to_line() for record in records]
        data = b"".join(lines)
        segment, start = self._put(data)
        for record, line in zip(records, lines, strict=True):
            self._index(record.cell.id, record.head, _Place(segment, start, len(line)))
            start += len(line)
        self._read[segment] = start

    def compact(self) -> None:
        """Merge segments, without lines that are damaged or replaced by later ones.

        Only the driver may call it, once every planned cell has ended: cells with damaged records have then run again.
        """
        there = self._segments()
        old = {name for name, size in there.items() if self._read.get(name) == size or name in self.torn}
        spoilt = self.damaged or self.torn
        if not spoilt and len(old) <= MAX_SEGMENTS and self._lines <= 2 * len(self._places):
            return
        self.check()
        self._segment = None
        self._merge(old, 1 + max(map(_number, there), default=-1))
        for name in old:
            disk.remove(self.folder / name)
        self._rescan()

    def stamp(self) -> str:
        """Return a text that changes with the log."""
        return ",".join(f"{name}:{size}" for name, size in self._segments().items())

    def _merge(self, old: Collection[str], number: int) -> None:
        """Write the valid lines of `old`, in their order, to new segments from `number` on."""
        batch: list[bytes] = []
        size = 0
        for place in (place for place in self._places.values() if place.segment in old):
            batch.append(self._bytes(place))
            size += place.length
            if size >= SEGMENT_BYTES:
                write_atomic(self._path(number), b"".join(batch))
                batch, size, number = [], 0, number + 1
        if batch:
            write_atomic(self._path(number), b"".join(batch))

    def _put(self, data: bytes) -> tuple[str, int]:
        """Append to this run's segment; return its name and the offset of `data`."""
        if not is_local(self.folder):
            path = self._next()
            write_atomic(path, data)
            return path.name, 0
        if self._segment is None or self._segment.stat().st_size >= SEGMENT_BYTES:
            self._segment = self._next()
        return self._segment.name, append(self._segment, data)

    def _next(self) -> Path:
        """Return a new segment; the folder is listed once, since this writer is the only one."""
        if self._number is None or is_local(self.folder):
            self._number = max(map(_number, self._segments()), default=-1) + self.takeovers
        self._number += 1
        return self._path(self._number)

    def _path(self, number: int) -> Path:
        return self.folder / f"{number:06d}{'-' if self.token else ''}{self.token}.jsonl"

    def _segments(self) -> Mapping[str, int]:
        """Return the size of every segment, in order."""
        there = sizes(self.folder)
        return {name: there[name] for name in sorted(filter(SEGMENT.fullmatch, there), key=lambda n: (_number(n), n))}

    def _scan(self) -> None:
        there = self._segments()
        if not self._read.keys() <= there.keys():
            raise FileNotFoundError("a segment is gone")
        for name, size in there.items():
            start = self._read.get(name, 0)
            if size <= start:
                continue
            self.torn.pop(name, None)
            for offset, data in _lines(self.folder / name, start):
                if not data.endswith(b"\n"):
                    self.torn[name] = offset
                    continue
                self._read[name] = offset + len(data)
                line = split_line(data)
                if line is None:
                    self.damaged.append(f"{name}, byte {offset}")
                else:
                    self._index(line.cell_id, read_head(line), _Place(name, offset, len(data)))

    def _rescan(self) -> None:
        """Read the whole log again after its driver has compacted it."""
        for part in (self._heads, self._places, self._read, self.damaged, self.torn):
            part.clear()
        self._lines, self._held, self._number = 0, None, None
        self._scan()

    def _index(self, cell_id: str, head: Head, place: _Place) -> None:
        self._heads[cell_id] = head
        self._places[cell_id] = place
        self._lines += 1

    def _bytes(self, place: _Place) -> bytes:
        path, stop = self.folder / place.segment, place.offset + place.length
        if is_local(path):
            return read_range(path, place.offset, stop)
        if self._held is None or self._held[0] != place.segment or len(self._held[1]) < stop:
            self._held = place.segment, read_range(path)
        return self._held[1][place.offset : stop]


def _number(segment: str) -> int:
    found = SEGMENT.fullmatch(segment)
    return int(found[1]) if found else -1


def _lines(path: Path, start: int) -> Iterator[tuple[int, bytes]]:
    """Yield (offset, line) from `start` on; the last line may be unfinished."""
    offset = start
    if not is_local(path):
        for line in read_range(path, start).splitlines(keepends=True):
            yield offset, line
            offset += len(line)
        return
    with path.open("rb") as file:
        file.seek(start)
        for line in file:
            yield offset, line
            offset += len(line)
