"""Files that are either whole or not there, and lines that are there for good once they are written."""

from __future__ import annotations

import secrets
from pathlib import Path

from trainables.storage import disk
from trainables.storage.paths import is_local


def write_atomic(path: Path, data: bytes) -> None:
    """Write `data` to `path` so that a reader, or a crash at any moment, meets the old file or the new one.

    A new file has the mode that the process's umask gives, as any other file has.
    """
    if not is_local(path):
        disk.put(path, data)
        return
    beside = path.parent / f".{path.name}.{secrets.token_hex(6)}"
    try:
        with disk.create(beside) as file:
            disk.write(file, data)
            disk.sync(file)
        disk.replace(beside, path)
    except BaseException:
        disk.remove(beside)
        raise
    disk.sync_folder(path.parent)


def append(path: Path, data: bytes) -> int:
    """Append `data` to a file on a disk, made where it is missing; the offset at which it begins.

    When this returns the data is there for good. OSError where the disk refuses it: the file is as it was.
    """
    with disk.extend(path) as file:
        start = file.tell()
        try:
            disk.write(file, data)
            disk.sync(file)
        except OSError:
            disk.truncate(path, start)
            raise
    if not start:
        disk.sync_folder(path.parent)
    return start
