"""JSON files with a checksum, so that a damaged file is never read as valid."""

from __future__ import annotations

import hashlib
import json
from pathlib import Path
from typing import Any

from trainables.cell import content_id
from trainables.errors import InputError
from trainables.storage.atomic import write_atomic
from trainables.storage.paths import read_range

CHECKSUM = "checksum"


class DamagedError(InputError):
    """A file of a sweep whose content is not what was written."""

    why = ""
    """What is wrong with it."""


def write(path: Path, data: dict[str, Any], indent: int | None = None) -> None:
    """Write `data` with its checksum, atomically."""
    separators = None if indent else (",", ":")
    text = json.dumps(data | {CHECKSUM: content_id(data)}, indent=indent, separators=separators, allow_nan=False)
    write_atomic(path, text.encode())


def read(path: Path) -> dict[str, Any]:
    """Return the data that `write` wrote; a file of an older version has no checksum, and is read without.

    Raises DamagedError, which says how to repair the file; InputError where it is missing or cannot be read.
    """
    try:
        data = json.loads(read_range(path))
    except OSError as error:
        raise InputError(f"cannot read {path}: {error.strerror or error}") from None
    except (ValueError, RecursionError) as error:
        raise damaged(path, str(error)) from None
    if not isinstance(data, dict):
        raise damaged(path, "it is no JSON object")
    checksum = data.pop(CHECKSUM, None)
    if checksum is not None and checksum != content_id(data):
        raise damaged(path, "it does not agree with its checksum")
    if data.get("schema") != 1:
        raise InputError(f"{path} is not of schema 1")
    return data


def damaged(path: Path, why: str) -> DamagedError:
    """Return the error for a damaged file, which says what that costs and how to repair it."""
    error = DamagedError(
        f"{path} is damaged ({why}): no record is lost by that, and the `deltatune sweep` command that made the sweep "
        "writes it again"
    )
    error.why = why
    return error


def digest(path: Path) -> str | None:
    """Return the SHA-256 of a file; None where it is missing."""
    try:
        with path.open("rb") as file:
            return hashlib.file_digest(file, "sha256").hexdigest()
    except OSError:
        return None
