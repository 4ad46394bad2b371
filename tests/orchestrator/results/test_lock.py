"""One driver at a sweep: looking takes no lock, a lease that is lost is noticed, and records are never written over."""

from __future__ import annotations

import json
import logging
import os
import threading
import time
from collections.abc import Iterator
from functools import partial
from pathlib import Path

import pytest

from orchestrator import clock
from orchestrator.errors import LeaseLostError
from orchestrator.results import checked_json, lock
from orchestrator.results.lock import DRIVER, driver, locked, writing_to
from orchestrator.results.records.plan_file import PlanFile
from orchestrator.results.records.record_log import RecordLog
from tests.orchestrator.records import record
from trainables.errors import InputError
from trainables.storage.paths import storage_path


@pytest.fixture
def bucket(monkeypatch: pytest.MonkeyPatch, request: pytest.FixtureRequest) -> Iterator[Path]:
    """An object store in this process's memory, with short leases."""
    monkeypatch.setattr(lock, "SETTLE_SECONDS", 0.0)
    monkeypatch.setattr(lock, "LEASE_SECONDS", 0.4)
    path = storage_path(f"memory://deltatune/{request.node.name}")
    yield path
    path.fs.store.clear()  # type: ignore[attr-defined]


def test_looking_never_refuses_a_driver_that_starts_meanwhile(tmp_path: Path) -> None:
    over = threading.Event()

    def look() -> None:
        while not over.is_set():
            driver(tmp_path)

    threads = [threading.Thread(target=look) for _ in range(4)]
    for thread in threads:
        thread.start()
    try:
        for _ in range(100):
            with locked(tmp_path):
                assert driver(tmp_path) == f"process {os.getpid()} on {os.uname().nodename}"
    finally:
        over.set()
        for thread in threads:
            thread.join()
    assert driver(tmp_path) is None


def test_looking_changes_nothing_on_disk(tmp_path: Path) -> None:
    before = os.stat(tmp_path).st_mtime_ns
    assert driver(tmp_path) is None
    assert list(tmp_path.iterdir()) == []
    assert os.stat(tmp_path).st_mtime_ns == before


@pytest.mark.parametrize(
    ("changes", "later", "lives"),
    [
        ({}, 0, True),
        ({"started": "1"}, 0, False),  # the number of a dead process was given to another
        ({"pid": 2**22 + 1}, 0, False),
        ({"machine": "elsewhere"}, 3, True),
        ({"machine": "elsewhere"}, -3600, False),
    ],
)
def test_a_driver_that_has_died_is_none(tmp_path: Path, changes: dict[str, object], later: float, lives: bool) -> None:
    (tmp_path / DRIVER).write_text(json.dumps(lock._me() | changes | {"alive": time.time() + later}))
    assert (driver(tmp_path) is not None) is lives


def test_a_second_writer_into_mlflow_is_refused_by_name(tmp_path: Path) -> None:
    says = f"is being written into MLflow by process {os.getpid()} on "
    mlflow = partial(writing_to, tmp_path, "mlflow", "MLflow")
    with mlflow(), pytest.raises(InputError, match=says), mlflow():
        pass
    with mlflow(), locked(tmp_path), writing_to(tmp_path, "jsonl", "another tracker"):
        pass


def test_a_lease_is_renewed_and_a_second_driver_refused(bucket: Path) -> None:
    with locked(bucket):
        time.sleep(0.6)
        assert driver(bucket) is not None
        with pytest.raises(InputError, match="is being run by process"), locked(bucket):
            pass
    assert driver(bucket) is None


def test_a_dead_drivers_lease_on_another_machine_is_free_and_a_live_ones_with_a_wrong_clock_is_not(
    bucket: Path,
) -> None:
    other = {"pid": 1, "host": "elsewhere", "machine": "elsewhere", "alive": time.time() - 3600, "token": "0" * 32}
    (bucket / DRIVER).write_text(json.dumps(other))
    with locked(bucket):
        assert str(os.getpid()) in str(driver(bucket))
    (bucket / DRIVER).write_text(json.dumps(other))
    timer = threading.Timer(0.1, lambda: (bucket / DRIVER).write_text(json.dumps(other | {"alive": 1.0})))
    timer.start()
    with pytest.raises(InputError, match="process 1 on elsewhere"), locked(bucket):
        pass
    timer.join()


def test_two_drivers_never_write_over_each_others_records_and_the_one_without_the_lease_stops(bucket: Path) -> None:
    told = threading.Event()
    with locked(bucket, on_lost=told.set) as first:
        one = RecordLog(bucket / "records")
        one.guard(first)
        one.append([record(0)])
        (bucket / DRIVER).unlink()  # the storage was away for longer than a lease
        with locked(bucket) as second:
            two = RecordLog(bucket / "records")
            two.guard(second)
            two.append([record(1)])
            one.append([record(2)])  # it does not know yet
            two.append([record(3)])
            assert told.wait(5)
            with pytest.raises(LeaseLostError, match=rf"was taken over by process {os.getpid()} on "):
                one.append([record(4)])
    everything = RecordLog(bucket / "records")
    everything.refresh()
    assert sorted(head.cell.seed for head in everything.heads().values()) == [0, 1, 2, 3]
    assert driver(bucket) is None


def test_a_lease_that_another_has_had_meanwhile_is_lost(bucket: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Its file is gone once the other has ended: a driver that was frozen must not take that for its own."""
    hold = lock.Hold(bucket, {"token": "a" * 32}, token="a" * 8)
    hold.verify()
    assert not hold.lost, "within the lease nobody can have taken it"
    now = clock.since_boot()
    monkeypatch.setattr(clock, "since_boot", lambda: now + lock.LEASE_SECONDS)
    with pytest.raises(LeaseLostError):
        hold.check()


def test_a_heartbeat_that_took_so_long_that_another_may_have_come_meanwhile_gives_the_lease_up(
    bucket: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    hold = lock.Hold(bucket, {"token": "a" * 32}, token="a" * 8)
    hold.beat()
    now, write = clock.since_boot(), lock._write

    def slow(folder: Path, file: str, who: lock.Who) -> None:
        write(folder, file, who)
        monkeypatch.setattr(clock, "since_boot", lambda: now + 100)

    monkeypatch.setattr(lock, "_write", slow)
    hold.beat()
    assert hold.lost
    assert not (bucket / DRIVER).exists()


def test_a_lease_that_only_a_late_heartbeat_has_put_back_is_lost(bucket: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A driver that was frozen in the middle of it finds its own token, though another has had the lease meanwhile."""
    hold = lock.Hold(bucket, {"token": "a" * 32}, token="a" * 8)
    now, write = clock.since_boot(), lock._write
    told: list[bool] = []

    def frozen(folder: Path, file: str, who: lock.Who) -> None:
        monkeypatch.setattr(clock, "since_boot", lambda: now + 100)
        write(folder, file, who)
        with pytest.raises(LeaseLostError):
            hold.check()
        told.append(True)

    monkeypatch.setattr(lock, "_write", frozen)
    hold.beat()
    assert told
    assert hold.lost
    assert not (bucket / DRIVER).exists(), "the next driver need not wait"


def test_what_a_driver_was_writing_when_it_lost_its_lease_counts_less_than_what_the_present_one_writes(
    bucket: Path,
) -> None:
    """The frozen driver comes to its end last, and has found no file of the present one when it began to write."""
    first, second = lock.Hold(bucket, {}, token="f" * 8), lock.Hold(bucket, {}, token="0" * 8, takeovers=1)
    logs, plans = [RecordLog(bucket / "records") for _ in "12"], [PlanFile(bucket) for _ in "12"]
    for hold, log, plan in zip((first, second), logs, plans, strict=True):
        log.guard(hold)
        plan.guard(hold)
    log, plan = logs[0], plans[0]
    segment = log._next()
    there = bucket / f"plan-000001-{first.token}.json"
    logs[1].append([record(1).model_copy(update={"seconds": 2.0})])
    plans[1].write({"schema": 1, "who": "second"})
    segment.write_bytes(record(1).model_copy(update={"seconds": 1.0}).to_line())
    checked_json.write(there, {"schema": 1, "who": "first"})
    again = RecordLog(bucket / "records")
    again.refresh()
    found = again.record(record(1).cell.id)
    assert found is not None
    assert found.seconds == 2.0
    assert checked_json.read(PlanFile(bucket).path())["who"] == "second"


def test_the_plan_of_an_older_version_on_an_object_store_is_read_and_then_replaced(bucket: Path) -> None:
    checked_json.write(bucket / "plan.json", {"schema": 1, "who": "old"})
    plan = PlanFile(bucket)
    assert checked_json.read(plan.path())["who"] == "old"
    for token in ("a" * 8, "b" * 8, "c" * 8):
        plan.guard(lock.Hold(bucket, {}, token=token))
        for turn in range(2):
            plan.write({"schema": 1, "who": f"{token} {turn}"})
        assert checked_json.read(PlanFile(bucket).path())["who"] == f"{token} 1"
    assert len(list(bucket.glob("plan*.json"))) == 2, "and the one before, for those who are about to read it"


def test_compaction_takes_away_no_record_that_it_has_not_read(bucket: Path) -> None:
    mine, other = RecordLog(bucket / "records", token="aa"), RecordLog(bucket / "records", token="bb")
    for seed in range(20):
        mine.append([record(seed)])
    other.append([record(30)])
    mine.compact()
    again = RecordLog(bucket / "records")
    again.refresh()
    assert sorted(head.cell.seed for head in again.heads().values()) == [*range(20), 30]
    assert len(list((bucket / "records").iterdir())) == 2
    assert again.record(record(7).cell.id) == record(7)


def test_a_heartbeat_that_does_not_arrive_is_in_the_log_and_the_next_one_is_sent(
    bucket: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    write, sent = lock._write, threading.Event()

    def flaky(folder: Path, file: str, who: lock.Who) -> None:
        if not caplog.text:
            raise RuntimeError("the bucket does not answer")
        write(folder, file, who)
        sent.set()

    with caplog.at_level(logging.INFO, "deltatune"), locked(bucket):
        monkeypatch.setattr(lock, "_write", flaky)
        assert sent.wait(5)
    assert f"no heartbeat in {bucket}: the bucket does not answer" in caplog.text
    assert driver(bucket) is None


def test_a_lock_that_cannot_be_removed_is_in_the_log(
    bucket: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    with caplog.at_level(logging.INFO, "deltatune"), locked(bucket):
        monkeypatch.setattr(lock.disk, "remove", lambda path: 1 / 0)
    assert f"the lock in {bucket} is not removed: division by zero" in caplog.text
