"""A storage that is no disk: an S3 on loopback. The same results, the same locks, the same resumption."""

from __future__ import annotations

import contextlib
import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import yaml
from conftest import DEEP, timeless
from harness import points, space, wait_for

from orchestrator.results import checked_json, lock, progress
from orchestrator.results.sweep_folder import Results
from orchestrator.tracking.uri import tracking_uri
from tests.deltatune.cli.in_process import command
from tests.small_figures import DRAWN_SMALL
from trainables.errors import InputError
from trainables.storage.paths import read_range, storage_path

moto_server = pytest.importorskip("moto.server")
pytest.importorskip("s3fs")

KEYS = {"AWS_ACCESS_KEY_ID": "test", "AWS_SECRET_ACCESS_KEY": "test", "AWS_DEFAULT_REGION": "us-east-1"}


@pytest.fixture(scope="module")
def bucket() -> Iterator[str]:
    """The URL of an empty bucket."""
    server = moto_server.ThreadedMotoServer(ip_address="127.0.0.1", port=0, verbose=False)
    server.start()
    host, port = server.get_host_and_port()
    with pytest.MonkeyPatch.context() as patch:
        for name, value in (KEYS | {"AWS_ENDPOINT_URL": f"http://{host}:{port}"}).items():
            patch.setenv(name, value)
        import s3fs

        s3fs.S3FileSystem().mkdir("bucket")
        yield "s3://bucket/storage"
    server.stop()


def checkpointed(folder: Path) -> bool:
    """Whether a cell has a checkpoint; a folder of a bucket is gone with its last file, even while it is listed."""
    with contextlib.suppress(FileNotFoundError):
        return bool(list((folder / "checkpoints").glob("*.checkpoint")))
    return False


@pytest.mark.slow  # the simulation does the same with every kind of kill
@pytest.mark.usefixtures("quick_figures")
def test_a_killed_sweep_on_an_object_store_goes_on_from_its_checkpoints(
    bucket: str, calm_deep: Path, tmp_path: Path
) -> None:
    storage, file = storage_path(bucket), tmp_path / "space.yaml"
    file.write_text(yaml.safe_dump(space(**DEEP), sort_keys=False))
    words = ["sweep", str(file), "--storage", bucket, "--no-mlflow", "--local", "--checkpoint-every", "0"]
    program = [sys.executable, *DRAWN_SMALL, *words, "--workers", "2"]
    with subprocess.Popen(program, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL) as driver:
        wait_for(lambda: checkpointed(storage / "small"))
        driver.send_signal(signal.SIGSTOP)  # so that it is not done by the time that the other one has started
        assert f"process {driver.pid}" in str(lock.driver(storage / "small"))
        code, _, err = command(*words, "--workers", "2")
        assert code == 2
        assert f"is being run by process {driver.pid}" in err
        os.kill(driver.pid, signal.SIGKILL)
    code, _, err = command(*words, "--workers", "1")
    assert code == 0, err
    results = Results.open(storage, "small")
    assert timeless(results.tables()[1]).equals(points(calm_deep))
    names = {path.name for path in (storage / "small").iterdir()}
    assert any(name.startswith("plan-") for name in names), "each driver has a file of its own"
    assert {"points.parquet", "table.csv", "report.html", "figures", "best.yaml", "driver.log"} <= names
    assert not list((storage / "small" / "checkpoints").glob("*.checkpoint"))
    told = json.loads(command("status", "small", "--storage", bucket, "--json")[1])
    assert told["stages"]["transfer"]["missing"] == 0


def alive(folder: Any) -> float:
    """When the lease was last renewed."""
    return float(json.loads(read_range(folder / lock.DRIVER))["alive"])


def test_a_lease_is_kept_alive_and_a_dead_ones_is_free(bucket: str, monkeypatch: pytest.MonkeyPatch) -> None:
    folder = storage_path(bucket) / "leased"
    monkeypatch.setattr(lock, "SETTLE_SECONDS", 0.0)
    monkeypatch.setattr(lock, "LEASE_SECONDS", 3.0)
    with lock.locked(folder):
        since = alive(folder)
        wait_for(lambda: alive(folder) > since)
        assert lock.driver(folder) is not None
        with pytest.raises(InputError, match="is being run by process"), lock.locked(folder):
            pass
    assert lock.driver(folder) is None
    (folder / lock.DRIVER).write_text(json.dumps({"pid": 1, "host": "elsewhere", "alive": time.time() - 4}))
    with lock.locked(folder):
        assert str(os.getpid()) in str(lock.driver(folder))


def test_what_is_replaced_between_two_requests_of_its_reader_is_read(
    bucket: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    from s3fs.core import S3File

    folder = storage_path(bucket) / "replaced"
    fetch = S3File._fetch_range
    with lock.locked(folder) as hold:
        checked_json.write(folder / "plan.json", {"schema": 1})
        progress.write(folder, progress.Snapshot("transfer", 1))

        def beat_first(file: S3File, start: int, end: int) -> bytes:
            hold.beat()
            checked_json.write(folder / "plan.json", {"schema": 1, "again": time.time()})
            progress.write(folder, progress.Snapshot("transfer", 1, updated=time.time()))
            return bytes(fetch(file, start, end))

        monkeypatch.setattr(S3File, "_fetch_range", beat_first)
        assert lock.driver(folder) is not None
        hold.verify()
        assert not hold.lost
        assert checked_json.read(folder / "plan.json")["schema"] == 1
        assert progress.read(folder) is not None


def test_no_lease_is_taken_while_the_storage_does_not_answer(bucket: str, monkeypatch: pytest.MonkeyPatch) -> None:
    folder = storage_path(bucket) / "silent"

    def fail(*_: object) -> bytes:
        raise OSError(5, "Input/output error")

    monkeypatch.setattr(lock, "read_range", fail)
    sentence = r"cannot look up who holds .*\.driver\.json: Input/output error"
    with pytest.raises(InputError, match=sentence), lock.locked(folder):
        pass
    monkeypatch.undo()
    assert not (folder / lock.DRIVER).exists()


def test_mlflows_database_cannot_be_on_an_object_store(bucket: str, monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(InputError, match="--tracking-uri, or --no-mlflow"):
        tracking_uri(storage_path(bucket), None)


def test_a_storage_that_is_none_is_refused_in_a_sentence() -> None:
    with pytest.raises(InputError, match="got 'nowhere://x/y'"):
        storage_path("nowhere://x/y")
