"""Archives of sources: a zip of their .npz files and a manifest with the checksum of each."""

from __future__ import annotations

import hashlib
import io
import json
import re
import zipfile
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from orchestrator.sources.library import Entry, SourceLibrary, read_entry, row
from trainables.errors import InputError
from trainables.storage.atomic import write_atomic
from trainables.storage.files import read_file

MANIFEST = "manifest.json"
SCHEMA = 1
MAX_BYTES = 2**30
"""Largest unpacked size of an archive that is read."""
MAX_SOURCES = 10_000

_NAME = re.compile(r"[0-9a-f]{16}\.npz")
_DATE = (1980, 1, 1, 0, 0, 0)
"""The date of every member, so that equal sources give equal archives."""


def export_sources(library: SourceLibrary, entries: Iterable[Entry], path: Path) -> int:
    """Write sources to the file `path`, and return their number. Raises InputError where it cannot be written."""
    members: dict[str, bytes] = {}
    rows: list[dict[str, Any]] = []
    for entry in entries:
        name = f"{entry.id}.npz"
        members[name] = library.path(entry.id).read_bytes()
        rows.append({**row(entry), "file": name, "sha256": hashlib.sha256(members[name]).hexdigest()})
    manifest = json.dumps({"schema": SCHEMA, "sources": rows}, indent=1).encode()
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w", zipfile.ZIP_STORED) as archive:
        for name, data in {MANIFEST: manifest, **members}.items():
            archive.writestr(zipfile.ZipInfo(name, _DATE), data)
    try:
        write_atomic(path, stream.getvalue())
    except OSError as error:
        raise InputError(f"cannot write {path}: {error.strerror}") from None
    return len(members)


def import_sources(library: SourceLibrary, path: Path, names: list[str]) -> list[Entry]:
    """Import the sources of the archive `path` with these ids or tasks (none: all) into the library, all or nothing.

    Members are read by the manifest's names, which must be cell ids, so nothing in the archive becomes a path.
    Raises InputError for another or a damaged archive, one that is too large, and a name that is not in it.
    """
    contents = _members(path)
    found = [read_entry(data, f"{path}: {name}") for name, data in contents.items()]
    chosen = [entry for entry in found if not names or any(_named(entry, name) for name in names)]
    for name in names:
        if not any(_named(entry, name) for entry in found):
            there = ", ".join(f"{entry.id} ({entry.cell.task})" for entry in found)
            raise InputError(f"{path} has no source '{name}': there is {there}")
    for entry in chosen:
        if library.has(entry.id) and library.entry(entry.id).knowledge.digest != entry.knowledge.digest:
            raise InputError(f"{path}: the library has another source {entry.id}; remove that one first")
    return [library.add(contents[f"{entry.id}.npz"], f"{path}: {entry.id}.npz") for entry in chosen]


def _named(entry: Entry, name: str) -> bool:
    return entry.id.startswith(name) or entry.cell.task == name


def _members(path: Path) -> dict[str, bytes]:
    """Return the library files in an archive by name, their checksums verified."""
    try:
        with zipfile.ZipFile(io.BytesIO(read_file(path, MAX_BYTES))) as archive:
            infos = archive.infolist()
            size = sum(info.file_size for info in infos)
            if size > MAX_BYTES or len(infos) > MAX_SOURCES:
                raise InputError(
                    f"{path} unpacks to {size} bytes in {len(infos)} files, "
                    f"more than {MAX_BYTES} bytes in {MAX_SOURCES} files"
                )
            rows = _manifest(path, _read(archive, MANIFEST))
            members = {str(row.get("file")): _read(archive, str(row.get("file"))) for row in rows}
    except InputError:
        raise
    except OSError as error:
        raise InputError(f"cannot read {path}: {error.strerror or error}") from None
    except Exception as error:  # a damaged archive may raise anything: zlib.error, BadZipFile, KeyError, ...
        raise InputError(f"{path} is damaged ({error})") from None
    for each in rows:
        name = str(each.get("file"))
        if hashlib.sha256(members[name]).hexdigest() != each.get("sha256"):
            raise InputError(f"{path} is damaged ({name} does not agree with its checksum)")
    return members


def _read(archive: zipfile.ZipFile, name: str) -> bytes:
    """Return a member's bytes, but no more than its entry declares."""
    if name != MANIFEST and not _NAME.fullmatch(name):
        raise InputError(f"a source's file is called by its cell id (got '{name}')")
    with archive.open(name) as file:
        return file.read(archive.getinfo(name).file_size)


def _manifest(path: Path, data: bytes) -> list[dict[str, Any]]:
    manifest = json.loads(data)
    rows = manifest.get("sources") if isinstance(manifest, dict) and manifest.get("schema") == SCHEMA else None
    if not isinstance(rows, list) or not all(isinstance(each, dict) for each in rows):
        raise InputError(f"{path} is not an archive of sources of schema {SCHEMA}")
    return rows
