"""Folders that can be written to, and files of a storage that must be on a disk for a while."""

from __future__ import annotations

import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from trainables.errors import InputError
from trainables.storage.paths import is_local


def absolute(path: Path) -> Path:
    """A path without `~` or dots; a URL as it is."""
    return path.expanduser().resolve() if is_local(path) else path


def make_folder(path: Path) -> Path:
    """Create `path` and check that it can be written to; InputError where not. The absolute path."""
    path = absolute(path)
    try:
        if not is_local(path):
            probe = path / ".writable"
            probe.write_bytes(b"")
            probe.unlink()
            return path
        path.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=path):
            return path
    except OSError as error:
        raise InputError(f"cannot write to the folder {path}: {error.strerror or error}") from None


@contextmanager
def workbench(folder: Path) -> Iterator[Path]:
    """A folder on a disk for files that are to be in `folder`: itself, or one whose files are put there at the end."""
    if is_local(folder):
        yield folder
        return
    with tempfile.TemporaryDirectory(prefix="deltatune-") as name:
        yield Path(name)
        for path in sorted(Path(name).rglob("*")):
            if path.is_file():
                (folder / path.relative_to(name).as_posix()).write_bytes(path.read_bytes())


@contextmanager
def local_copy(path: Path) -> Iterator[Path]:
    """A file on a disk with the name and the contents of `path`."""
    if is_local(path):
        yield path
        return
    with tempfile.TemporaryDirectory(prefix="deltatune-") as name:
        copy = Path(name) / path.name
        copy.write_bytes(path.read_bytes())
        yield copy
