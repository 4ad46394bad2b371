"""Atomic writes of files, and durable appends."""

from __future__ import annotations

import secrets
from pathlib import Path

from trainables.storage import disk
from trainables.storage.paths import is_local


def write_atomic(path: Path, data: bytes, durable: bool = True) -> None:
    """Write `data` to `path` atomically: readers, and a crash at any moment, see the old file or the new one.

    A new file has the mode given by the process's umask. durable: False for what may be damaged by a power loss, since
    its checksum then tells; it is several times as fast.
    """
    if not is_local(path):
        disk.put(path, data)
        return
    temporary = path.parent / f".{path.name}.{secrets.token_hex(6)}"
    try:
        with disk.create(temporary) as file:
            disk.write(file, data)
            if durable:
                disk.sync(file)
        disk.replace(temporary, path)
    except BaseException:
        disk.remove(temporary)
        raise
    if durable:
        disk.sync_folder(path.parent)


def append(path: Path, data: bytes) -> int:
    """Append `data` to a file on a disk, created where it is missing, and return its offset.

    The data is durable when this returns. Raises OSError where the disk refuses it; the file is then unchanged.
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
