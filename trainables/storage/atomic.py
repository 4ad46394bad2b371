"""Files that are either whole or not there."""

from __future__ import annotations

import os
import secrets
from pathlib import Path

from trainables.storage.paths import is_local


def write_atomic(path: Path, data: bytes) -> None:
    """Write `data` to `path` so that a reader, or a crash at any moment, meets the old file or the new one.

    A new file has the mode that the process's umask gives, as any other file has.
    """
    if not is_local(path):
        path.write_bytes(data)  # an object store puts an object whole or not at all
        return
    beside = path.parent / f".{path.name}.{secrets.token_hex(6)}"
    try:
        with open(os.open(beside, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o666), "wb") as file:
            file.write(data)
            file.flush()
            os.fsync(file.fileno())
        os.replace(beside, path)
    except BaseException:
        beside.unlink(missing_ok=True)
        raise
    sync_folder(path.parent)


def sync_folder(folder: Path) -> None:
    """Make new names in `folder` last, where the system lets a folder be synchronised."""
    try:
        descriptor = os.open(folder, os.O_RDONLY)
    except OSError:
        return
    try:
        os.fsync(descriptor)
    except OSError:
        pass
    finally:
        os.close(descriptor)
