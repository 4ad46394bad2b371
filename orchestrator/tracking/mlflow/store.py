"""Opens MLflow's store, creates a local database atomically, and refuses a damaged one in a sentence.

MLflow creates its SQLite tables in some thousand steps. A process killed meanwhile would leave a database that cannot
be opened, so the tables are created in a temporary file, which is renamed once it is complete. Until then no write is
synchronised to the disk.
"""

from __future__ import annotations

import contextlib
import os
import shutil
import sqlite3
import tempfile
import time
from pathlib import Path

from mlflow.exceptions import MlflowException
from mlflow.store.db import utils
from mlflow.tracking import MlflowClient
from sqlalchemy import Engine, event
from sqlalchemy.exc import SQLAlchemyError

from orchestrator.errors import SweepError
from orchestrator.tracking.uri import local_database
from trainables.storage import disk

PREFIX = ".mlflow-new-"
"""Of the temporary folders in which databases are created."""

ABANDONED_SECONDS = 3600.0
"""Age from which such a folder counts as abandoned."""

DAMAGED = ("already exists", "duplicate column", "no such table", "no such column", "malformed", "not a database")
"""Parts of SQLite's messages on a damaged or incomplete database."""


_OPENED: set[str] = set()
"""The files of the databases that `connect` has opened."""


def connect(uri: str) -> MlflowClient:
    """Return a client of the store `uri`; create the database of a local one where it is missing.

    Transactions in a local database with write-ahead logging are not synchronised to the disk one by one: a cell's run
    takes six. A power failure may cost the last ones, which `deltatune sync` writes again, and damages nothing.

    Raises SweepError for a damaged database, with the commands that replace it.
    """
    path = local_database(uri)
    try:
        if path is not None:
            make(path)
            _OPENED.add(os.path.realpath(path))
            if not event.contains(Engine, "connect", _synchronise_less):
                event.listen(Engine, "connect", _synchronise_less)
        return MlflowClient(uri)
    except (SQLAlchemyError, sqlite3.Error, MlflowException) as error:
        if path is None or not any(words in str(error) for words in DAMAGED):
            raise
        raise SweepError(
            f"MLflow's database {path} is damaged or incomplete; the results are complete without it: "
            f"move it away (mv {path} {path}.damaged), and 'deltatune sync SWEEP' writes each sweep again"
        ) from None


def _synchronise_less(connection: object, _: object) -> None:
    """Let a new connection to a database of _OPENED synchronise at checkpoints of its log only."""
    if not isinstance(connection, sqlite3.Connection):
        return
    with contextlib.suppress(sqlite3.DatabaseError):  # of a file that is no database, which its first query tells too
        _, _, file = connection.execute("PRAGMA database_list").fetchone()
        if os.path.realpath(file) in _OPENED and connection.execute("PRAGMA journal_mode").fetchone() == ("wal",):
            connection.execute("PRAGMA synchronous=NORMAL")


def make(path: Path) -> None:
    """Create an empty MLflow database with write-ahead logging, atomically, unless there is one."""
    if path.exists() and path.stat().st_size:
        return
    path.parent.mkdir(parents=True, exist_ok=True)
    _remove_abandoned(path.parent)
    with tempfile.TemporaryDirectory(dir=path.parent, prefix=PREFIX) as folder:
        new = Path(folder) / path.name
        engine = utils.create_sqlalchemy_engine(f"sqlite:///{new}")  # type: ignore[no-untyped-call]
        event.listen(engine, "connect", lambda connection, _: connection.execute("PRAGMA synchronous=OFF"))
        try:
            utils._initialize_tables(engine)  # type: ignore[no-untyped-call]
        finally:
            engine.dispose()  # an open connection must not see the file renamed
        with contextlib.closing(sqlite3.connect(new)) as database:
            database.execute("PRAGMA journal_mode=WAL")  # twice the rate of small writes, and readers never block
        with new.open("rb") as whole:
            disk.sync(whole)
        _put(new, path)


def _put(new: Path, path: Path) -> None:
    """Move a new database to its place, unless another process was faster, whose runs would be lost."""
    try:
        path.hardlink_to(new)  # fails where a file is, unlike a renaming
        return
    except FileExistsError:
        if path.stat().st_size:
            return
    except OSError:  # a file system without links
        if path.exists() and path.stat().st_size:
            return
    new.replace(path)


def _remove_abandoned(folder: Path) -> None:
    """Remove the temporary folders of killed processes."""
    for old in folder.glob(f"{PREFIX}*"):
        with contextlib.suppress(OSError):
            if time.time() - old.stat().st_mtime > ABANDONED_SECONDS:
                shutil.rmtree(old)
