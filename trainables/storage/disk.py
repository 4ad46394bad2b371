"""The elementary file operations, each a single system call, between any two of which a machine may crash.

`atomic` uses them to write whatever must survive a crash. Simulations in tests replace them.
"""

from __future__ import annotations

import os
from pathlib import Path
from typing import BinaryIO


def create(path: Path) -> BinaryIO:
    """Create and open a file that does not exist yet, with the mode given by the process's umask."""
    return open(os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o666), "wb")


def extend(path: Path) -> BinaryIO:
    """Open a file at its end, creating it where it is missing."""
    return path.open("ab")


def write(file: BinaryIO, data: bytes) -> None:
    """Write data to a file."""
    file.write(data)
    file.flush()


def sync(file: BinaryIO) -> None:
    """Wait until the written data is on the disk."""
    os.fsync(file.fileno())


def truncate(path: Path, length: int) -> None:
    """Truncate a file."""
    os.truncate(path, length)


def replace(old: Path, new: Path) -> None:
    """Rename a file to `new`, replacing any file there."""
    os.replace(old, new)


def remove(path: Path) -> None:
    """Remove a file if it exists."""
    path.unlink(missing_ok=True)


def put(path: Path, data: bytes) -> None:
    """Write an object to an object store, atomically."""
    path.write_bytes(data)


def sync_folder(folder: Path) -> None:
    """Make renames in `folder` durable, on systems that can synchronise a folder."""
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
