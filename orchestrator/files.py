"""Folders that can be written to."""

from __future__ import annotations

import tempfile
from pathlib import Path

from trainables.errors import InputError


def make_folder(path: Path) -> Path:
    """Create `path` and check that it can be written to; InputError where not. The absolute path."""
    path = path.expanduser().resolve()
    try:
        path.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=path):
            return path
    except OSError as error:
        raise InputError(f"cannot write to the folder {path}: {error.strerror}") from None
