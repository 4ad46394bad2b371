"""One process at a time writes a sweep into MLflow, and its run there never stays RUNNING."""

from __future__ import annotations

import json
import threading
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from deltatune import publish
from orchestrator import clock
from orchestrator.analysis.findings import Findings, find
from orchestrator.errors import LeaseLostError, LeaseUnknownError
from orchestrator.execution.session import SweepSession
from orchestrator.results import lock
from orchestrator.results.sweep_folder import Results
from orchestrator.tracking import tracker
from orchestrator.tracking.mlflow import mirror as mlflow_mirror
from orchestrator.tracking.sync import sync_now
from orchestrator.tracking.tracker import Tracker
from orchestrator.tracking.trackers import MLFLOW
from tests.orchestrator.local_sweeps import LOCAL, space
from tests.small_figures import small_figures
from trainables.errors import InputError
from trainables.storage.paths import storage_path


class Store:
    """A store of runs, and what stands in for its Mirror: `known` is what one process has found there."""

    def __init__(self) -> None:
        self.runs: list[str] = []
        self.status: str | None = None
        self.broken = False

    def mirror(self, results: Results, uri: str) -> Any:
        self.status = "RUNNING"
        return SimpleNamespace(
            known=set(self.runs),
            parent="p",
            write_configurations=lambda *words: None,
            write_cell=lambda *words: None,
            end=self.end,
            finish=lambda *words: None,
        )

    def end(self, status: str) -> None:
        self.status = status


@pytest.fixture
def store(monkeypatch: pytest.MonkeyPatch) -> Store:
    made = Store()

    def finish(findings: Findings, artifacts: object) -> None:
        if made.broken:
            raise OSError("the store is away")
        made.status = "FINISHED"

    def mirror(results: Results, uri: str, check: Callable[[], None]) -> Any:
        found = made.mirror(results, uri)
        found.finish = finish
        found.write_cell = lambda stage, head, read: (
            head.cell.id in found.known or check() or (made.runs.append(head.cell.id), found.known.add(head.cell.id))
        )
        return found

    mirror.errors = (OSError,)  # type: ignore[attr-defined]
    monkeypatch.setattr(mlflow_mirror, "Mirror", mirror)
    return made


@pytest.fixture(scope="module")
def done(tmp_path_factory: pytest.TempPathFactory) -> Results:
    storage = tmp_path_factory.mktemp("tracked")
    with small_figures(), SweepSession.open(storage, "small", space()) as now:
        now.run(LOCAL)
        publish.publish(now.results)
    return Results.open(storage, "small")


def test_sync_beside_a_sweep_that_writes_to_mlflow_is_refused_and_makes_no_double(done: Results, store: Store) -> None:
    sweep = Tracker(done, "sqlite:///x")
    records = [(stage, record) for stage, _, record in done.records() if record]
    sweep.record(*records[0])
    waited = threading.Event()
    while not store.runs:
        waited.wait(0.01)
    with pytest.raises(InputError, match="is being written into MLflow by process"):
        sync_now(find(done), "sqlite:///x", [])
    assert sweep.finish(find(done), []) == "p"
    sync_now(find(done), "sqlite:///x", [])
    assert sorted(store.runs) == sorted(record.cell.id for _, record in records)


def test_a_sweep_that_ends_during_a_sync_waits_for_it(
    done: Results, store: Store, monkeypatch: pytest.MonkeyPatch
) -> None:
    with MLFLOW.held(done.folder):
        monkeypatch.setattr(tracker, "PATIENCE", 0.0)
        refused = Tracker(done, "sqlite:///x")
        assert refused.finish(find(done), []) is None
        assert "is being written into MLflow by process" in str(refused.error)
    monkeypatch.setattr(tracker, "PATIENCE", 10.0)
    other = MLFLOW.held(done.folder)
    other.__enter__()
    threading.Timer(0.5, lambda: other.__exit__(None, None, None)).start()
    assert Tracker(done, "sqlite:///x").finish(find(done), []) == "p"


@pytest.mark.parametrize("by_hand", [False, True], ids=["sweep", "sync"])
def test_a_store_that_fails_at_the_end_is_not_left_running(done: Results, store: Store, by_hand: bool) -> None:
    store.broken = True
    if by_hand:
        with pytest.raises(Exception, match="the store is away"):
            sync_now(find(done), "sqlite:///x", [])
    else:
        assert Tracker(done, "sqlite:///x").finish(find(done), []) is None
    assert store.status == "FAILED"


def test_a_sync_stopped_by_ctrl_c_has_not_failed(done: Results, store: Store, monkeypatch: pytest.MonkeyPatch) -> None:
    def interrupted(self: Results) -> None:
        raise KeyboardInterrupt

    found = find(done)
    monkeypatch.setattr(Results, "planned_heads", interrupted)
    with pytest.raises(KeyboardInterrupt):
        sync_now(found, "sqlite:///x", [])
    assert store.status == "KILLED"


def test_who_was_frozen_until_another_took_over_writes_nothing_more(
    done: Results, store: Store, monkeypatch: pytest.MonkeyPatch
) -> None:
    """On an object store, where a lease can be lost: before each write to a tracker the holder looks it up."""
    folder = storage_path("memory://deltatune/frozen")
    monkeypatch.setattr(lock, "SETTLE_SECONDS", 0.0)
    records = [(stage, record) for stage, _, record in done.records() if record]
    sweep = Tracker(done, "sqlite:///x")
    monkeypatch.setattr(done, "folder", folder)
    try:
        sweep._write(*records[0])
        now = clock.since_boot()
        (folder / ".mlflow.json").write_text(json.dumps(lock._me() | {"pid": 1, "host": "elsewhere"}))
        monkeypatch.setattr(clock, "since_boot", lambda: now + lock.LEASE_SECONDS)
        with pytest.raises(LeaseLostError, match="was taken over by process 1 on elsewhere"):
            sweep._write(*records[1])
        assert store.runs == [records[0][1].cell.id]
        sweep.stop()
        assert (lock._read(folder, ".mlflow.json") or {})["host"] == "elsewhere", "another's lease was removed"
    finally:
        folder.fs.store.clear()  # type: ignore[attr-defined]


def test_where_nobody_can_tell_who_writes_nothing_is_written(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    hold = lock.Hold(tmp_path, {"token": "a" * 32}, token="a" * 8)
    (tmp_path / lock.DRIVER).mkdir()  # reading it fails
    hold.check_surely()
    now = clock.since_boot()
    monkeypatch.setattr(clock, "since_boot", lambda: now + lock.LEASE_SECONDS)
    with pytest.raises(LeaseUnknownError, match="cannot look up who holds the lease"):
        hold.check_surely()
    hold.check()  # a record is written over by nobody: it may be tried
