"""The provenance of results: versions and commit."""

from __future__ import annotations

import functools
import json
import platform
import subprocess
from importlib import metadata
from pathlib import Path

import orchestrator

PACKAGES = ("deltatune", "ray", "torch", "gymnasium", "numpy", "scipy", "numba", "mlflow")

STAGED_FILE = "deltatune-provenance.json"
"""The file with version and commit next to a copy of the packages on a cluster."""


@functools.cache
def versions() -> dict[str, str]:
    """Return the versions of Python and of the installed packages that a result may depend on."""
    found = {"python": platform.python_version()}
    for package in PACKAGES:
        try:
            found[package] = metadata.version(package)
        except metadata.PackageNotFoundError:
            continue
    staged = _staged().get("version")
    return found | {"deltatune": staged} if staged else found


@functools.cache
def commit() -> str:
    """Return the git commit of this code, with '+changes' where its checkout differs from it.

    'unknown' outside a checkout of deltatune, such as in another repository in which it is only installed.
    """
    if staged := _staged().get("commit"):
        return staged
    try:
        _git("ls-files", "--error-unmatch", str(Path(__file__).resolve()))
        head = _git("rev-parse", "--short=12", "HEAD")
        changed = _git("status", "--porcelain", "--untracked-files=no")
    except (OSError, subprocess.SubprocessError):
        return "unknown"
    return head + ("+changes" if changed else "")


def write_staged(folder: Path) -> None:
    """Write commit and version to `folder`, next to a copy of the packages without git and metadata."""
    data = {"commit": commit(), "version": versions().get("deltatune", "")}
    (folder / STAGED_FILE).write_text(json.dumps(data))


def packages_folder() -> Path:
    """Return the folder that contains the packages of deltatune."""
    return Path(str(orchestrator.__file__)).resolve().parent.parent


def _staged() -> dict[str, str]:
    """Return what `write_staged` has written next to this code; empty outside such a copy."""
    try:
        data: dict[str, str] = json.loads((packages_folder() / STAGED_FILE).read_text())
    except (OSError, ValueError):
        return {}
    return data


def _git(*words: str) -> str:
    done = subprocess.run(
        ["git", *words], cwd=packages_folder(), capture_output=True, text=True, check=True, timeout=10
    )
    return done.stdout.strip()
