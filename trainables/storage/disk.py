"""The steps in which files change: each is one call of the system, and between any two of them a machine may die.

Whatever must survive a crash is written through these, by `atomic`. The simulated driver of the tests puts
its own in their place.
"""

from __future__ import annotations

import os
from pathlib import Path
from typing import BinaryIO


def create(path: Path) -> BinaryIO:
    """Open a file that is not there yet, with the mode that the process's umask gives."""
    return open(os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o666), "wb")


def extend(path: Path) -> BinaryIO:
    """Open a file at its end, made where it is missing."""
    return path.open("ab")


def write(file: BinaryIO, data: bytes) -> None:
    """Hand data to the system."""
    file.write(data)
    file.flush()


def sync(file: BinaryIO) -> None:
    """Wait until what was written is on the disk."""
    os.fsync(file.fileno())


def truncate(path: Path, length: int) -> None:
    """Cut a file off."""
    os.truncate(path, length)


def replace(old: Path, new: Path) -> None:
    """Give a file the name `new`, whatever had it before."""
    os.replace(old, new)


def remove(path: Path) -> None:
    """Remove a file, if it is there."""
    path.unlink(missing_ok=True)


def put(path: Path, data: bytes) -> None:
    """Put an object into a store: whole, or not at all."""
    path.write_bytes(data)


def sync_folder(folder: Path) -> None:
    """Make the names in `folder` last, where the system lets a folder be synchronised."""
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
