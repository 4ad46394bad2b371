"""Folders that can be written to."""

from __future__ import annotations

import tempfile
from pathlib import Path

from trainables.errors import InputError
from trainables.storage import is_local


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
