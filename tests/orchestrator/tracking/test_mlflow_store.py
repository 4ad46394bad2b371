"""MLflow's database is whole or not there, whenever its maker is killed; a damaged one is refused in a sentence."""

from __future__ import annotations

import contextlib
import sqlite3
import time
from pathlib import Path
from typing import Any
from unittest import mock

import pytest
import sqlalchemy
from mlflow.store.db import utils

from orchestrator.errors import SweepError
from orchestrator.tracking.mlflow import store
from orchestrator.tracking.mlflow.store import PREFIX, connect, make
from orchestrator.tracking.uri import local_database


class Killed(BaseException):
    """A kill: nothing catches it."""


def interrupted(engine: sqlalchemy.Engine, statement: int) -> sqlalchemy.Engine:
    """The engine, which is killed at its `statement`th statement."""
    left = [statement]

    def count(*_: object) -> None:
        left[0] -= 1
        if not left[0]:
            raise Killed

    sqlalchemy.event.listen(engine, "before_cursor_execute", count)
    return engine


@pytest.mark.parametrize("statement", [1, 30, 300])
def test_a_kill_while_the_tables_are_made_leaves_no_database(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, statement: int
) -> None:
    engine_of = utils.create_sqlalchemy_engine
    monkeypatch.setattr(utils, "create_sqlalchemy_engine", lambda uri: interrupted(engine_of(uri), statement))
    with pytest.raises((Killed, sqlalchemy.exc.SQLAlchemyError)):
        make(tmp_path / "mlflow.db")
    assert not (tmp_path / "mlflow.db").exists()


def test_a_database_is_made_once_and_opens(tmp_path: Path) -> None:
    path = tmp_path / "new" / "mlflow.db"
    path.parent.mkdir()
    path.touch()  # what a kill at the very first moment leaves
    uri = f"sqlite:///{path}"
    assert local_database(uri) == path
    run = connect(uri).create_run("0")
    assert connect(uri).get_run(run.info.run_id).info.status == "RUNNING"
    with contextlib.closing(sqlite3.connect(path)) as database:
        assert database.execute("PRAGMA journal_mode").fetchone() == ("wal",)
    assert not list(path.parent.glob(f"{PREFIX}*"))


@pytest.mark.parametrize("links", [True, False])
def test_of_two_that_make_the_database_at_once_the_first_keeps_its_runs(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, links: bool
) -> None:
    path, written = tmp_path / "mlflow.db", []

    def faster(file: object) -> None:  # while the second has made its tables, the first puts its own there and writes
        monkeypatch.undo()
        if not links:
            monkeypatch.setattr(Path, "hardlink_to", mock.Mock(side_effect=PermissionError))
        client = connect(f"sqlite:///{path}")
        written.append((client, client.create_run("0").info.run_id))

    monkeypatch.setattr(store.disk, "sync", faster)
    make(path)
    ((client, run),) = written
    assert client.get_run(run).info.status == "RUNNING"
    assert connect(f"sqlite:///{path}").get_run(run).info.run_id == run


def test_no_connection_is_left_open_to_a_new_database(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    opened: list[sqlite3.Connection] = []
    connect = sqlite3.connect

    def noted(*words: Any, **more: Any) -> sqlite3.Connection:
        opened.append(connect(*words, **more))
        return opened[-1]

    monkeypatch.setattr(store.sqlite3, "connect", noted)
    make(tmp_path / "mlflow.db")
    assert opened
    for connection in opened:
        with pytest.raises(sqlite3.ProgrammingError, match="closed"):
            connection.execute("SELECT 1")


def test_a_half_made_database_is_refused_with_what_mends_it(tmp_path: Path) -> None:
    path = tmp_path / "mlflow.db"
    with contextlib.closing(sqlite3.connect(path)) as database:  # as a kill within a migration leaves it
        database.execute("CREATE TABLE datasets (dataset_uuid TEXT)")
    with pytest.raises(SweepError, match=r"mlflow.db is damaged.*'deltatune sync SWEEP'"):
        connect(f"sqlite:///{path}")


def test_a_file_that_is_no_database_is_refused_at_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    waits: list[float] = []
    monkeypatch.setattr(time, "sleep", waits.append)  # as MLflow does for minutes where it cannot connect
    path = tmp_path / "mlflow.db"
    path.write_bytes(b"garbage" * 1000)
    with pytest.raises(SweepError, match="is damaged"):
        connect(f"sqlite:///{path}")
    assert waits == []


def test_only_the_connections_to_a_databases_own_log_are_synchronised_less(tmp_path: Path) -> None:
    told: dict[str, list[int]] = {}

    def tell(connection: sqlite3.Connection, _: object) -> None:
        (mode,) = connection.execute("PRAGMA synchronous").fetchone()
        told.setdefault(Path(connection.execute("PRAGMA database_list").fetchone()[2]).name, []).append(mode)

    for name in ("ours.db", "rollback.db", "other.db"):
        make(tmp_path / name)
    with contextlib.closing(sqlite3.connect(tmp_path / "rollback.db")) as database:
        database.execute("PRAGMA journal_mode=DELETE")
    client = connect(f"sqlite:///{tmp_path / 'ours.db'}")
    connect(f"sqlite:///{tmp_path / 'rollback.db'}")
    sqlalchemy.event.listen(sqlalchemy.Engine, "connect", tell)
    try:
        client.create_run("0")
        for name in ("rollback.db", "other.db"):
            sqlalchemy.create_engine(f"sqlite:///{tmp_path / name}").connect().close()
    finally:
        sqlalchemy.event.remove(sqlalchemy.Engine, "connect", tell)
    normal, full = 1, 2
    assert set(told["ours.db"]) == {normal}
    assert told["rollback.db"] == told["other.db"] == [full]
