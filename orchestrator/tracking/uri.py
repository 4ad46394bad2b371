"""Resolves and validates the tracking URI of a sweep."""

from __future__ import annotations

import os
import re
from pathlib import Path

from orchestrator.tracking.trackers import TRACKERS, scheme, tracker_of
from trainables.errors import InputError
from trainables.storage.folders import absolute
from trainables.storage.paths import is_local


def tracking_uri(storage: Path, given: str | None) -> str:
    """Return `given`, else MLFLOW_TRACKING_URI, else a database in the storage folder.

    Raises InputError for an unknown scheme, a storage in which no database can be, and for credentials that others
    could read: in the address of a server, or in `given`, which is on the command line.
    """
    uri = given or os.environ.get("MLFLOW_TRACKING_URI")
    if uri is None:
        if not is_local(storage):
            raise InputError(f"MLflow's database cannot be at {storage}: give --tracking-uri, or --no-mlflow")
        uri = f"sqlite:///{absolute(storage) / 'mlflow.db'}"
    kind = tracker_of(uri)
    if kind is None:
        known = ", ".join(f"{name}:" for each in TRACKERS for name in each.schemes)
        raise InputError(f"a tracking URI must start with {known} (got '{shown(uri)}')")
    if scheme(uri) in ("http", "https") and "@" in uri:
        raise InputError(
            f"a tracking server's address must hold no user name, password or token (got '{shown(uri)}'): set "
            "MLFLOW_TRACKING_USERNAME and MLFLOW_TRACKING_PASSWORD, or MLFLOW_TRACKING_TOKEN, in the environment"
        )
    if given and re.search(r"//[^/]*:.*@", given):
        raise InputError(
            f"a database's password does not belong on a command line (got '{shown(uri)}'): "
            "set MLFLOW_TRACKING_URI in the environment"
        )
    return kind.checked(uri)


def shown(uri: str) -> str:
    """Return a tracking URI without user name and password, for printing."""
    return re.sub(r"//.*@", "//***@", uri)


def local_database(uri: str) -> Path | None:
    """Return the file of a SQLite store, or None for another store."""
    scheme, _, path = uri.partition(":///")
    return Path(path) if scheme.split("+")[0] == "sqlite" and path and path != ":memory:" else None
