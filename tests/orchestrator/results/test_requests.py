"""An object store is asked little: each request takes its time, and is paid for."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from orchestrator.results.records.record_log import RecordLog
from orchestrator.sources.library import SourceLibrary
from tests.orchestrator.records import record
from trainables.cell import Cell
from trainables.knowledge import Knowledge
from trainables.storage.paths import storage_path
from trainables.training import worker
from trainables.training.messages import STOP

REQUESTS = ("ls", "info", "exists", "cat_file", "_open", "pipe_file", "_rm", "rm", "rm_file")
"""What a file system is asked."""


@pytest.fixture
def bucket(request: pytest.FixtureRequest) -> Iterator[Path]:
    """An object store in this process's memory."""
    path = storage_path(f"memory://deltatune/{request.node.name}")
    yield path
    path.fs.store.clear()  # type: ignore[attr-defined]


@pytest.fixture
def asked(bucket: Path, monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """The requests to it, in order."""
    asked: list[str] = []
    fs = type(bucket.fs)  # type: ignore[attr-defined]
    for name in REQUESTS:
        real = getattr(fs, name)

        def counted(self: object, path: str, *words: Any, name: str = name, real: Any = real, **more: Any) -> Any:
            asked.append(name)
            return real(self, path, *words, **more)

        monkeypatch.setattr(fs, name, counted)
    return asked


def writes(asked: list[str]) -> int:
    return asked.count("_open") + asked.count("pipe_file")


def test_a_record_is_one_request_to_write_and_all_of_them_one_to_list_and_one_for_each_segment(
    bucket: Path, asked: list[str]
) -> None:
    log = RecordLog(bucket / "records", token="aa")
    for seed in range(10):
        log.append([record(seed)])
    assert asked.count("ls") == 1
    assert writes(asked) == 10
    assert len(asked) <= 1 + 10 + 1
    asked.clear()
    reader = RecordLog(bucket / "records")
    reader.refresh()
    assert [name for name in asked if name not in ("ls", "cat_file", "_open", "info")] == []
    assert asked.count("ls") == 1
    assert asked.count("cat_file") == 10
    asked.clear()
    log.compact()
    for seed in range(10):
        assert log.record(record(seed).cell.id) == record(seed)
    assert asked.count("cat_file") <= 10, "a GET for each segment, not for each record"


def test_compaction_reads_each_segment_once(bucket: Path, asked: list[str], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("orchestrator.results.records.record_log.MAX_SEGMENTS", 2)
    log = RecordLog(bucket / "records", token="aa")
    for segment in range(3):
        log.append([record(10 * segment + seed) for seed in range(10)])
    asked.clear()
    log.compact()
    assert len(list((bucket / "records").iterdir())) == 1
    assert asked.count("cat_file") <= 3 + 1, "and the merged one, to index it"


def test_a_source_that_is_saved_is_one_request_and_all_that_are_there_are_one_to_list(
    bucket: Path, asked: list[str]
) -> None:
    library = SourceLibrary(bucket)
    cells = [Cell.create("q_learning", "windy_gridworld", seed, {"episodes": 1}) for seed in range(10)]
    for cell in cells[:5]:
        library.save(cell, Knowledge({"q": np.zeros((400, 4))}))
    assert writes(asked) == 5 + 1, "whether it can be written to is tried once"
    asked.clear()
    other = SourceLibrary(bucket)
    for _ in range(3):
        assert [other.has(cell.id) for cell in cells] == [True] * 5 + [False] * 5
    assert 0 < len(asked) <= 4, "one to list, with what the file system asks itself for it"
    other.save(cells[5], Knowledge({"q": np.zeros((400, 4))}))
    asked.clear()
    assert other.has(cells[5].id)
    assert asked == []


def test_a_worker_looks_for_the_request_to_stop_as_seldom_as_it_may(
    bucket: Path, asked: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    now = [100.0]
    monkeypatch.setattr(worker, "time", SimpleNamespace(monotonic=lambda: now[0]))
    stop = worker.StopFile(bucket)
    for _ in range(600):  # a minute
        assert not stop()
        now[0] += 0.1
    assert asked.count("exists") <= 1 + 60 / worker.REMOTE_LOOK_SECONDS
    assert worker.REMOTE_LOOK_SECONDS >= 5
    (bucket / STOP).write_bytes(b"")
    now[0] += worker.REMOTE_LOOK_SECONDS
    assert stop()
    asked.clear()
    assert stop()
    assert asked == [], "who has been asked to stop looks no further"
