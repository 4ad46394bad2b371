"""Writable folders, and local copies of a storage's files."""

from __future__ import annotations

import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from trainables.errors import InputError
from trainables.storage.paths import is_local


def absolute(path: Path) -> Path:
    """Return a path without `~` and dots; a URL is unchanged."""
    return path.expanduser().resolve() if is_local(path) else path


def make_folder(path: Path) -> Path:
    """Create `path`, and return it as an absolute path. Raises InputError where it is not writable."""
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
def staged_folder(folder: Path) -> Iterator[Path]:
    """Yield a local directory whose files are uploaded to `folder` on exit; `folder` itself if it is on a disk."""
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
    """Yield a file on a disk with the name and the content of `path`."""
    if is_local(path):
        yield path
        return
    with tempfile.TemporaryDirectory(prefix="deltatune-") as name:
        copy = Path(name) / path.name
        copy.write_bytes(path.read_bytes())
        yield copy
