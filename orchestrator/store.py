"""Which MLflow store a sweep is copied to."""

from __future__ import annotations

import os
from pathlib import Path
from urllib.parse import urlparse

from orchestrator.files import absolute
from trainables.errors import InputError
from trainables.storage import is_local

SCHEMES = ("sqlite", "postgresql", "mysql", "mssql", "http", "https", "databricks")


def tracking_uri(storage: Path, given: str | None) -> str:
    """`given`, else MLFLOW_TRACKING_URI, else a database in the storage folder. InputError for an unknown scheme."""
    uri = given or os.environ.get("MLFLOW_TRACKING_URI")
    if uri is None:
        if not is_local(storage):
            raise InputError(f"MLflow's database cannot be at {storage}: give --tracking-uri, or --no-mlflow")
        uri = f"sqlite:///{absolute(storage) / 'mlflow.db'}"
    scheme = urlparse(uri).scheme.split("+")[0]
    if scheme not in SCHEMES:
        raise InputError(f"a tracking URI must start with {', '.join(f'{s}:' for s in SCHEMES)} (got '{uri}')")
    return uri
