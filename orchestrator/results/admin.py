"""Renames and removes sweeps that no driver runs."""

from __future__ import annotations

import shutil
from pathlib import Path

from orchestrator.results import checked_json
from orchestrator.results.lock import DRIVER, locked
from orchestrator.results.sweep_folder import SWEEP, Results, check_name
from trainables.errors import InputError
from trainables.storage.paths import is_local


def remove(results: Results) -> None:
    """Delete a sweep's folder. Raises InputError where a driver runs the sweep."""
    with locked(results.folder):
        (results.folder / SWEEP).unlink()  # first: what an interrupted removal leaves is no sweep
    if is_local(results.folder):
        shutil.rmtree(results.folder)
        return
    for path in results.folder.rglob("*"):
        if path.is_file():
            path.unlink()


def rename(results: Results, name: str) -> Results:
    """Rename a sweep. Raises InputError for a bad or taken name, a running sweep, and on an object store."""
    folder: Path = results.storage / check_name(name)
    if folder.exists():
        raise InputError(f"there is a sweep or a folder '{name}' in {results.storage} already")
    if not is_local(folder):
        raise InputError(f"a sweep in {results.storage} cannot be renamed: an object store has no folders to rename")
    with locked(results.folder):
        results.folder.rename(folder)
        checked_json.write(folder / SWEEP, checked_json.read(folder / SWEEP) | {"name": name}, indent=1)
    (folder / DRIVER).unlink(missing_ok=True)  # it has moved with the folder
    return Results(folder)
