"""What a result was made with: versions, commit, machine."""

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
"""Says beside a copy of the packages that went to a cluster what they are a copy of."""


@functools.cache
def versions() -> dict[str, str]:
    """Return the version of Python and of each package that a result may depend on; missing ones are left out."""
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

    'unknown' outside a checkout of it: a repository in which this code is merely installed is another's.
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
    """Write commit and version beside a copy of the packages in `folder`, which has neither git nor metadata."""
    data = {"commit": commit(), "version": versions().get("deltatune", "")}
    (folder / STAGED_FILE).write_text(json.dumps(data))


def packages_folder() -> Path:
    """Return the folder in which the packages of deltatune lie side by side."""
    return Path(str(orchestrator.__file__)).resolve().parent.parent


def _staged() -> dict[str, str]:
    """Return what `write_staged` has written beside this code; empty where it is no such copy."""
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
