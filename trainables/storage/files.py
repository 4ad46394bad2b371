"""Reading a file that a user has named, which may be of any kind."""

from __future__ import annotations

import os
import stat
from pathlib import Path

from trainables.errors import InputError
from trainables.storage.paths import is_local


def read_file(path: Path, most: int) -> bytes:
    """Return the contents of a file of at most that many bytes.

    Raises InputError where it cannot be read, is larger, or is a folder, a pipe or a device, reading of which may
    never end.
    """
    try:
        size = _size(path) if is_local(path) else 0
        if size <= most:
            data = path.read_bytes()
            if len(data) <= most:
                return data
            size = len(data)
    except InputError:
        raise
    except OSError as error:
        raise InputError(f"cannot read {path}: {error.strerror or error}") from None
    except ValueError as error:  # a NUL in its name
        raise InputError(f"cannot read {str(path)!r}: {error}") from None
    raise InputError(f"cannot read {path}: it has {size:,} bytes, more than {most:,}")


def _size(path: Path) -> int:
    found = os.stat(path)
    if not stat.S_ISREG(found.st_mode) and not stat.S_ISDIR(found.st_mode):
        raise InputError(f"cannot read {path}: it is a pipe or a device, not a file")
    return 0 if stat.S_ISDIR(found.st_mode) else found.st_size  # reading a folder raises an error that names it
