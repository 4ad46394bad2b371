"""The tracker that writes JSON lines, for jq, pandas, or a program that watches a file: jsonl:FOLDER.

FOLDER/SWEEP-ID.jsonl gets a line per cell as it ends, with its curve, and at the end one per configuration with its
statistics and one for the sweep. A cell that is trained again gets another line: the last of an id counts, and at the
end of the sweep one of each remains, cells first.
"""

from __future__ import annotations

import json
import math
import os
import re
from collections.abc import Callable, Iterable, Iterator, Mapping
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

from orchestrator.results.records.record import Head, Record
from orchestrator.results.sweep_folder import Results
from orchestrator.tracking.configurations import Configurations
from trainables.cell import content_id
from trainables.errors import InputError
from trainables.storage.folders import absolute, make_folder
from trainables.storage.paths import storage_path

if TYPE_CHECKING:
    from orchestrator.analysis.findings import Findings

HEAD = re.compile(rb'\{"kind": "(\w+)", "id": "(\w+)", "digest": "(\w+)"')
"""The beginning of a line: cell, configuration or sweep; its id; a digest of its content."""


def check(uri: str) -> None:
    """Raise InputError unless the URI names a writable folder on a disk."""
    text = uri.partition(":")[2]
    if not text or ("://" in text and not text.startswith("file://")):
        raise InputError(f"jsonl: takes a folder on a disk, jsonl:FOLDER (got '{uri}')")
    folder = absolute(storage_path(text))
    there = next(path for path in (folder, *folder.parents) if path.exists())
    if not there.is_dir() or not os.access(there, os.W_OK):
        raise InputError(f"jsonl: cannot write to the folder {folder} (got '{uri}')")


class JsonLines:
    """A sweep's file of JSON lines."""

    errors: ClassVar[tuple[type[Exception], ...]] = (OSError, InputError)

    def __init__(self, results: Results, uri: str, check: Callable[[], None] = lambda: None) -> None:
        self._check = check
        self._results, self._meta = results, results.meta()
        self._id = content_id([results.name, self._meta["created"]])
        self._configurations = Configurations(results)
        self._path = make_folder(storage_path(uri.partition(":")[2])) / f"{results.name}-{self._id}.jsonl"
        self.parent = str(self._path)
        self._digests = {key: digest for key, digest, _ in self._lines()}
        self._ended: dict[str, tuple[str, Head]] = {}

    def write_configurations(self, findings: Findings) -> None:
        """Leave them to `finish`, which writes a new file."""

    def write_cell(self, stage: str, head: Head, read: Callable[[], Record | None]) -> None:
        """Append the line of an ended cell, unless the file has it."""
        self._ended[head.cell.id] = stage, head
        self._cell(stage, head, read, self._configurations.of(stage, head.cell))

    def finish(self, findings: Findings, artifacts: Iterable[Path]) -> None:
        """Append a line per configuration and one for the sweep; then keep one line per id that the sweep still has."""
        from orchestrator.analysis.tables.summary_table import numbers

        cells = findings.cells
        of = cells.groupby("cell_id", sort=False)["group"].agg(list).to_dict() if len(cells) else {}
        for cell_id, (stage, head) in self._ended.items():
            if cell_id in of:
                self._cell(stage, head, partial(self._results.log.record, cell_id), of[cell_id])
        last = {key: number for number, (key, _, _) in enumerate(self._lines())}
        rows = [
            self._line("configuration", group.id, {**numbers(group), "hyperparameters": dict(group.hyperparameters)})
            for group in findings.groups
        ]
        rows += [
            self._line(
                "configuration",
                group.id,
                {"confirms": True, **numbers(group), "hyperparameters": dict(group.hyperparameters)},
            )
            for group in findings.confirmations
        ]
        temporary = self._path.with_name(f".{self._path.name}")
        with temporary.open("wb") as file:
            for number, (key, _, line) in enumerate(self._lines()):
                if key[0] == "cell" and key[1] in of and last[key] == number:
                    file.write(line)
            file.writelines([*rows, self._of_sweep("FINISHED")])
        self._check()
        temporary.replace(self._path)

    def end(self, status: str) -> None:
        """Append a line with the sweep's final status."""
        self._append(self._of_sweep(status))

    def _of_sweep(self, status: str) -> bytes:
        space = self._meta["space"]
        fields = {"status": status, "space": space["name"], "agents": list(space["agents"]), "seeds": space["seeds"]}
        return self._line("sweep", self._id, fields | {name: self._meta[name] for name in ("created", "commit")})

    def _cell(self, stage: str, head: Head, read: Callable[[], Record | None], configurations: list[str]) -> None:
        """Append a cell's line, unless its last line is equal."""
        key, digest = ("cell", head.cell.id), content_id([head.digest, head.status, configurations])
        if self._digests.get(key) == digest or (record := read()) is None:
            return
        cell, source = head.cell, head.cell.sources[0] if head.cell.sources else None
        fields: dict[str, Any] = {"stage": stage, "status": head.status, "agent": cell.agent, "task": cell.task}
        fields |= {"source": source.kind if source else "none", "source_task": source.task if source else None}
        fields |= {"seed": cell.seed, "configurations": configurations, "hyperparameters": cell.hyperparameters}
        fields |= {"finished": head.finished, "seconds": head.seconds, "error": head.error, **head.summary}
        fields |= {"commit": head.commit, "versions": head.versions, "curve": record.points}
        self._append(self._line(*key, fields, digest))
        self._digests[key] = digest

    def _line(self, kind: str, name: str, fields: Mapping[str, Any], digest: str | None = None) -> bytes:
        """Return the line of a cell, a configuration or the sweep."""
        plain = {name: _plain(value) for name, value in fields.items()}
        own = {"kind": kind, "id": name, "digest": digest or content_id(plain), "sweep": self._results.name}
        return json.dumps(own | {"sweep_id": self._id} | plain, allow_nan=False).encode() + b"\n"

    def _append(self, line: bytes) -> None:
        self._check()
        with self._path.open("ab") as file:
            file.write(line)

    def _lines(self) -> Iterator[tuple[tuple[str, str], str, bytes]]:
        """Yield (kind and id, digest, line) of the file, after truncating a line that a killed process left."""
        if not self._path.exists():
            return
        whole = 0
        with self._path.open("rb") as file:
            for line in file:
                found = HEAD.match(line)
                if found and line.endswith(b"\n"):
                    kind, name, digest = (part.decode() for part in found.groups())
                    yield (kind, name), digest, line
                if line.endswith(b"\n"):
                    whole += len(line)
        if whole < self._path.stat().st_size:
            self._check()
            os.truncate(self._path, whole)


def _plain(value: Any) -> Any:
    """Return the value, or None for NaN and infinities, which JSON does not have."""
    return None if isinstance(value, float) and not math.isfinite(value) else value
