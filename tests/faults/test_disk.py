"""Disks fill up and files break: the sweep says which, keeps what it has, and goes on when there is room again."""

from __future__ import annotations

import shutil
from pathlib import Path
from typing import Any, BinaryIO

import pytest
from conftest import CELLS, record_lines, set_record_lines
from harness import assert_same, sweep

from orchestrator.errors import SweepError
from orchestrator.results.records import record_log
from orchestrator.results.sweep_folder import Results
from orchestrator.sources.library import SourceLibrary
from trainables.storage import atomic, disk

FULL = OSError(28, "No space left on device")


def test_a_disk_that_is_full_while_records_are_written_stops_the_sweep_and_loses_nothing(
    finished: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    calls = 0

    def full(file: BinaryIO) -> None:
        raise FULL

    def append(path: Path, data: bytes) -> int:
        nonlocal calls
        calls += 1
        with monkeypatch.context() as inner:
            if calls > 2:
                inner.setattr(disk, "sync", full)
            return atomic.append(path, data)

    with monkeypatch.context() as patch:
        patch.setattr(record_log, "append", append)
        with pytest.raises(SweepError, match=r"cannot write a record .*No space left.*; all earlier ones are kept"):
            sweep(tmp_path)
    there = len(Results.open(tmp_path, "small").heads())
    assert 0 < there < CELLS
    _, tally = sweep(tmp_path)
    assert tally.reused >= there, "a source whose knowledge was saved before its record is not trained again"
    assert tally.reused + tally.ran == CELLS
    assert_same(tmp_path, finished)


def test_a_disk_that_is_full_while_source_knowledge_is_written_loses_nothing(
    finished: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    save = SourceLibrary.save
    saved: list[Any] = []

    def full(library: SourceLibrary, *words: Any) -> None:
        if len(saved) == 2:
            raise FULL
        saved.append(words)
        save(library, *words)

    with monkeypatch.context() as patch:
        patch.setattr(SourceLibrary, "save", full)
        with pytest.raises(SweepError, match="No space left"):
            sweep(tmp_path)
    sweep(tmp_path)
    assert_same(tmp_path, finished)


def test_a_torn_and_a_flipped_record_are_run_again_and_nothing_else(finished: Path, tmp_path: Path) -> None:
    shutil.copytree(finished, tmp_path / "copy")
    storage = tmp_path / "copy"
    *lines, last = record_lines(Results.open(storage, "small"))
    lines[-3] = lines[-3].replace(b'"done"', b'"dono"')
    set_record_lines(Results.open(storage, "small"), [*lines, last[: len(last) // 2]])
    _, tally = sweep(storage)
    assert (tally.reused, tally.ran) == (CELLS - 2, 2)
    assert_same(storage, finished)


def test_the_cells_of_damaged_library_files_train_again(
    finished: Path, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    shutil.copytree(finished, tmp_path / "copy")
    storage = tmp_path / "copy"
    results = Results.open(storage, "small")
    set_record_lines(results, [line for line in record_lines(results) if b'"delta_gate"' not in line])
    paths = sorted((storage / "sources").glob("*.npz"))
    for path in paths:
        data = bytearray(path.read_bytes())
        data[len(data) // 2] ^= 1
        path.write_bytes(bytes(data))
    sweep(storage)
    assert all(f"{path.name} is damaged" in caplog.text for path in paths)
    assert_same(storage, finished)
