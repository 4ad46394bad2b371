"""The names of a sweep's pretrained sources in its last run: SWEEP/given.json."""

from __future__ import annotations

import json
import shlex
from collections.abc import Sequence
from pathlib import Path

from orchestrator.results import checked_json
from trainables.storage.paths import read_range

FILE = "given.json"


def write(folder: Path, names: Sequence[str]) -> None:
    """Record the names of the pretrained sources of the sweep in `folder`."""
    checked_json.write(folder / FILE, {"schema": 1, "sources": list(names)})


def read(folder: Path) -> list[str]:
    """Return the recorded names; the file of an older version has no checksum."""
    path = folder / FILE
    if not path.exists():
        return []
    try:
        data = json.loads(read_range(path))
    except (ValueError, RecursionError) as error:
        raise checked_json.damaged(path, str(error)) from None
    names = data if isinstance(data, list) else checked_json.read(path).get("sources")
    if not isinstance(names, list) or not all(isinstance(name, str) for name in names):
        raise checked_json.damaged(path, "it is no list of names")
    return names


def options(folder: Path) -> str:
    """Return the command-line options with which a sweep gets the same sources again."""
    return "".join(f" --source {shlex.quote(name)}" for name in read(folder))
