"""The record log: what has been written is there, what is damaged is not taken for it, and nothing else is lost."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest
from conftest import CELLS, record_lines, set_record_lines
from hypothesis import given
from hypothesis import strategies as st

from orchestrator.results.records import record_log
from orchestrator.results.records.record import split_line
from orchestrator.results.records.record_log import RecordLog
from orchestrator.results.sweep_folder import Results
from tests.orchestrator.records import record
from trainables.storage import disk


@pytest.fixture
def log(tmp_path: Path) -> RecordLog:
    return RecordLog(tmp_path)


def reopened(log: RecordLog) -> RecordLog:
    again = RecordLog(log.folder)
    again.refresh()
    return again


def test_every_record_of_a_sweep_reads_back_with_its_bits(finished: Path) -> None:
    results = Results.open(finished, "small")
    lines = record_lines(results)
    assert len(lines) == CELLS
    for line in lines:
        read = results.record(line.split(b"\t")[1].decode())
        assert read is not None
        assert read.to_line() == line
        assert read.head == results.heads()[read.cell.id]


def test_what_is_appended_is_there_at_once_and_for_good(log: RecordLog) -> None:
    log.append([record(0), record(1)])
    log.append([record(2)])
    for reader in (log, reopened(log)):
        assert [head.cell.seed for head in reader.heads().values()] == [0, 1, 2]
        assert reader.record(record(1).cell.id) == record(1)
    assert log.record(record(3).cell.id) is None


def test_the_last_line_of_a_cell_counts(log: RecordLog) -> None:
    log.append([record(0, "failed"), record(1)])
    log.append([record(0, value=5.0)])
    assert reopened(log).record(record(0).cell.id) == record(0, value=5.0)
    assert log.heads()[record(0).cell.id].status == "done"


def test_a_reader_takes_in_what_a_writer_adds(log: RecordLog) -> None:
    reader = RecordLog(log.folder)
    for seed in range(3):
        log.append([record(seed)])
        reader.refresh()
        assert len(reader.heads()) == seed + 1


@given(cut=st.integers(min_value=1, max_value=700))
def test_a_line_that_was_cut_off_costs_that_line_alone(tmp_path_factory: pytest.TempPathFactory, cut: int) -> None:
    log = RecordLog(tmp_path_factory.mktemp("log"))
    log.append([record(0), record(1)])
    path = next(log.folder.iterdir())
    data = path.read_bytes()
    path.write_bytes(data[: -min(cut, len(record(1).to_line()))])
    later = reopened(log)
    assert list(later.heads()) == [record(0).cell.id]
    later.append([record(1)])
    assert len(reopened(later).heads()) == 2
    assert len(list(log.folder.iterdir())) == 2, "a new writer never appends to a torn line"


@given(where=st.floats(min_value=0, max_value=0.999), bit=st.integers(min_value=0, max_value=7))
def test_one_flipped_bit_is_never_taken_for_a_result(
    tmp_path_factory: pytest.TempPathFactory, where: float, bit: int
) -> None:
    log = RecordLog(tmp_path_factory.mktemp("log"))
    log.append([record(0), record(1), record(2)])
    path = next(log.folder.iterdir())
    data = bytearray(path.read_bytes())
    start = len(record(0).to_line())
    data[start + int(where * len(record(1).to_line()))] ^= 1 << bit
    path.write_bytes(bytes(data))
    later = reopened(log)
    for seed in (0, 2):
        found = later.record(record(seed).cell.id)
        assert found is None or found == record(seed)
    assert later.record(record(1).cell.id) is None
    assert record(0).cell.id in later.heads()


def test_a_damaged_line_is_named(log: RecordLog) -> None:
    log.append([record(0), record(1)])
    path = next(log.folder.iterdir())
    path.write_bytes(path.read_bytes().replace(b'"seed":0', b'"seed":7'))
    assert reopened(log).damaged == ["000000.jsonl, byte 0"]


def test_a_disk_that_is_full_leaves_no_half_line(log: RecordLog, monkeypatch: pytest.MonkeyPatch) -> None:
    log.append([record(0)])

    def full(descriptor: int) -> None:
        raise OSError(28, "No space left on device")

    with monkeypatch.context() as patch:
        patch.setattr(disk, "sync", full)
        with pytest.raises(OSError, match="No space left"):
            log.append([record(1)])
    assert list(log.heads()) == [record(0).cell.id]
    log.append([record(2)])
    assert [head.cell.seed for head in reopened(log).heads().values()] == [0, 2]


@pytest.fixture
def many(log: RecordLog) -> RecordLog:
    """A log of more segments than are left alone, with superseded lines."""
    for seed in range(record_log.MAX_SEGMENTS + 2):
        RecordLog(log.folder).append([record(seed % 5, value=float(seed))])
    log.refresh()
    return log


def values(log: RecordLog) -> Iterator[float]:
    for cell_id in log.heads():
        found = log.record(cell_id)
        assert found is not None
        yield found.returns[-1]


def test_compaction_keeps_the_last_line_of_every_cell(many: RecordLog) -> None:
    before, reader = sorted(values(many)), reopened(many)
    many.compact()
    assert len(list(many.folder.iterdir())) == 1
    assert len(record_lines_of(many)) == 5
    for log in (many, reopened(many), reader):
        assert sorted(values(log)) == before
    many.append([record(9)])
    assert len(reopened(many).heads()) == 6


def test_a_crash_in_the_middle_of_compaction_loses_nothing(many: RecordLog, monkeypatch: pytest.MonkeyPatch) -> None:
    before = sorted(values(many))

    def crash(self: Path, missing_ok: bool = False) -> None:
        raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr(Path, "unlink", crash)
        with pytest.raises(KeyboardInterrupt):
            many.compact()
    assert sorted(values(reopened(many))) == before


def test_few_segments_are_left_alone(log: RecordLog) -> None:
    log.append([record(0)])
    log.compact()
    assert [path.name for path in log.folder.iterdir()] == ["000000.jsonl"]


def test_a_line_survives_splitting() -> None:
    line = record(3).to_line()
    parts = split_line(line)
    assert parts is not None
    assert parts.cell_id == record(3).cell.id
    assert split_line(line[1:]) is None
    assert split_line(b"") is None


def record_lines_of(log: RecordLog) -> list[bytes]:
    return [line for path in sorted(log.folder.glob("*.jsonl")) for line in path.read_bytes().splitlines()]


def test_a_sweep_says_where_its_log_is_damaged(finished: Path, tmp_path: Path) -> None:
    import shutil

    shutil.copytree(finished / "small", tmp_path / "small")
    results = Results.open(tmp_path, "small")
    first, *lines = record_lines(results)
    set_record_lines(results, [first[:-5] + b"xxxx\n", *lines])
    assert len(Results.open(tmp_path, "small").heads()) == CELLS - 1
