"""The source library as a product: nothing damaged gets in or out of it, and an archive is all of it or nothing."""

from __future__ import annotations

import io
import json
import time
import zipfile
from pathlib import Path

import numpy as np
import pytest

from orchestrator.results.records.record import Record
from orchestrator.sources.archive import MANIFEST, export_sources, import_sources
from orchestrator.sources.library import SourceLibrary, read_entry, row
from trainables import curve
from trainables.cell import Cell
from trainables.errors import InputError
from trainables.knowledge import Knowledge
from trainables.training.train import train

WINDS = ("windy_gridworld", "windy_gridworld:wind=small")


def _filled(storage: Path) -> SourceLibrary:
    library = SourceLibrary(storage)
    for task in WINDS:
        cell = Cell.create("q_learning", task, 0, {"episodes": 20})
        training = train(cell)
        points = curve.columns(training)
        seconds, digest = 0.1, curve.digest(points)
        record = Record(
            cell=cell, status="done", points=points, digest=digest, finished=time.time(), seconds=seconds,
            versions={"deltatune": "0"}, commit="0",
        )  # fmt: skip
        library.save(cell, training.knowledge(), record)
    return library


@pytest.fixture(scope="module")
def library(tmp_path_factory: pytest.TempPathFactory) -> SourceLibrary:
    return _filled(tmp_path_factory.mktemp("library"))


def test_a_source_comes_back_with_its_cell_its_record_and_its_arrays(library: SourceLibrary) -> None:
    entry = next(entry for entry in library.entries() if entry.cell.task == WINDS[1])
    assert entry.record is not None
    assert entry.record == library.record(entry.id)
    assert entry.id == entry.cell.id == entry.record.cell.id
    again = train(entry.cell)
    assert curve.columns(again)["greedy_return"] == entry.record.points["greedy_return"]
    assert again.knowledge().digest == entry.knowledge.digest == row(entry)["digest"]


@pytest.mark.parametrize(("names", "count"), [([], 2), (["windy_gridworld"], 1), (list(WINDS), 2)])
def test_sources_are_found_by_task_and_by_the_beginning_of_their_id(library, names, count) -> None:
    assert len(library.find(names)) == count
    first = library.ids()[0]
    assert [entry.id for entry in library.find([first[:10]])] == [first]


def test_what_is_not_there_is_refused_with_what_is(library: SourceLibrary) -> None:
    with pytest.raises(InputError, match=r"unknown source 'cartpole'.*windy_gridworld:wind=small"):
        library.find(["cartpole"])
    with pytest.raises(InputError) as caught:  # each task once, however many sources it has
        library.find(["cartpole", "acrobot"])
    assert str(caught.value).count("windy_gridworld:wind=small") == 1
    assert library.ids()[0] not in str(caught.value)
    with pytest.raises(InputError, match="16 hexadecimal digits"):
        library.remove("../../etc/passwd")


def test_one_altered_byte_is_one_sentence_that_names_the_file(library: SourceLibrary, tmp_path: Path) -> None:
    copy = SourceLibrary(tmp_path)
    path = library.path(library.ids()[0])
    data = bytearray(path.read_bytes())
    data[len(data) // 2] ^= 1
    (tmp_path / "sources").mkdir()
    copy.path(path.stem).write_bytes(data)
    with pytest.raises(InputError, match=f"{path.name} is damaged") as caught:
        copy.load(path.stem)
    assert "\n" not in str(caught.value)
    with pytest.raises(InputError, match=r"^theirs\.npz is damaged"):
        copy.add(bytes(data), "theirs.npz")


@pytest.mark.parametrize(
    ("arrays", "why"),
    [
        ({"q": np.zeros((400, 5))}, r"shape \(400, 5\)"),
        ({"q": np.zeros((400, 4), np.float32)}, "64-bit floats"),
        ({"q": np.full((400, 4), np.nan)}, "NaN"),
        ({"p": np.zeros((400, 4))}, "not a Q table"),
    ],
)
def test_a_whole_file_whose_arrays_do_not_fit_its_task_is_refused(arrays, why: str) -> None:
    cell = Cell.create("q_learning", WINDS[0], 0, {"episodes": 20})
    with pytest.raises(InputError, match=why):
        read_entry(Knowledge(arrays).to_bytes({"cell": cell.to_json()}), "theirs.npz")


@pytest.mark.parametrize(
    ("change", "why"),
    [
        ({"sizes": np.array([4, 64, 3])}, "4 inputs and 3 actions"),
        ({"sizes": np.array([4.0, 64.0, 2.0])}, "whole numbers"),
        ({"last": np.zeros(5, np.float32)}, "450 32-bit parameters"),
        ({"best": np.zeros(450)}, "32-bit parameters"),
        ({"best": np.full(450, np.inf, np.float32)}, "NaN or an infinity"),
    ],
)
def test_a_network_that_does_not_fit_its_task_is_refused(change, why: str) -> None:
    cell = Cell.create("dqn", "cartpole", 0, {"episodes": 1})
    arrays = {"sizes": np.array([4, 64, 2]), "last": np.zeros(450, np.float32), "best": np.zeros(450, np.float32)}
    read_entry(Knowledge(arrays).to_bytes({"cell": cell.to_json()}), "theirs.npz")
    with pytest.raises(InputError, match=why):
        read_entry(Knowledge(arrays | change).to_bytes({"cell": cell.to_json()}), "theirs.npz")


def test_export_and_import_carry_every_bit_and_equal_sources_make_equal_archives(library, tmp_path: Path) -> None:
    archives = [tmp_path / name for name in ("a.zip", "b.zip")]
    for archive in archives:
        assert export_sources(library, library.entries(), archive) == 2
    assert archives[0].read_bytes() == archives[1].read_bytes()
    other = SourceLibrary(tmp_path / "other")
    assert len(import_sources(other, archives[0], ["windy_gridworld"])) == 1
    assert len(import_sources(other, archives[0], [])) == 2
    assert [other.path(each).read_bytes() for each in other.ids()] == [
        library.path(each).read_bytes() for each in library.ids()
    ]


def test_a_source_that_is_there_with_other_arrays_is_not_overwritten(library: SourceLibrary, tmp_path: Path) -> None:
    export_sources(library, library.entries(), tmp_path / "all.zip")
    other = SourceLibrary(tmp_path / "other")
    entry = next(library.entries())
    other.save(entry.cell, Knowledge({"q": np.ones((400, 4))}))
    with pytest.raises(InputError, match=f"another source {entry.id}"):
        import_sources(other, tmp_path / "all.zip", [])
    assert other.ids() == [entry.id]


def _archive(path: Path, members: dict[str, bytes], names: dict[str, str]) -> Path:
    rows = [{"file": name, "sha256": digest} for name, digest in names.items()]
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr(MANIFEST, json.dumps({"schema": 1, "sources": rows}))
        for name, data in members.items():
            archive.writestr(name, data)
    return path


@pytest.mark.parametrize("name", ["../evil.npz", "/etc/passwd", "x.npz", "0123456789abcdef.npz/../../a"])
def test_no_name_in_an_archive_becomes_a_path(tmp_path: Path, name: str) -> None:
    path = _archive(tmp_path / "in" if (tmp_path / "in").exists() else tmp_path / "a.zip", {name: b"x"}, {name: "0"})
    with pytest.raises(InputError, match="called by its cell id"):
        import_sources(SourceLibrary(tmp_path / "storage"), path, [])
    assert sorted(each.name for each in tmp_path.rglob("*")) == ["a.zip"]


def test_an_archive_that_unpacks_to_more_than_the_limit_is_refused_unread(tmp_path: Path, monkeypatch) -> None:
    monkeypatch.setattr("orchestrator.sources.archive.MAX_BYTES", 10_000)
    path = _archive(tmp_path / "bomb.zip", {"0123456789abcdef.npz": b"\0" * 1_000_000}, {})
    assert path.stat().st_size < 10_000
    with pytest.raises(InputError, match="unpacks to 10000"):
        import_sources(SourceLibrary(tmp_path), path, [])


@pytest.mark.parametrize("data", [b"", b"PK\x03\x04", b"hello"])
def test_other_files_are_no_archives(tmp_path: Path, data: bytes) -> None:
    (tmp_path / "a.zip").write_bytes(data)
    with pytest.raises(InputError, match="damaged"):
        import_sources(SourceLibrary(tmp_path), tmp_path / "a.zip", [])


def test_an_altered_member_leaves_the_library_as_it_was(library: SourceLibrary, tmp_path: Path) -> None:
    export_sources(library, library.entries(), tmp_path / "all.zip")
    data = bytearray((tmp_path / "all.zip").read_bytes())
    start = data.rindex(b"PK\x03\x04") + 400
    data[start] ^= 1
    (tmp_path / "all.zip").write_bytes(data)
    with pytest.raises(InputError, match="damaged"):
        import_sources(SourceLibrary(tmp_path / "other"), tmp_path / "all.zip", [])
    assert SourceLibrary(tmp_path / "other").ids() == []


def test_a_member_that_the_manifest_has_another_checksum_for_is_refused(library, tmp_path: Path) -> None:
    name = f"{library.ids()[0]}.npz"
    data = library.path(library.ids()[0]).read_bytes()
    path = _archive(tmp_path / "a.zip", {name: data}, {name: "0" * 64})
    with pytest.raises(InputError, match="does not agree with its checksum"):
        import_sources(SourceLibrary(tmp_path / "other"), path, [])


def test_a_manifest_of_another_schema_is_refused(tmp_path: Path) -> None:
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w") as archive:
        archive.writestr(MANIFEST, json.dumps({"schema": 2, "sources": []}))
    (tmp_path / "a.zip").write_bytes(stream.getvalue())
    with pytest.raises(InputError, match="schema 1"):
        import_sources(SourceLibrary(tmp_path), tmp_path / "a.zip", [])
