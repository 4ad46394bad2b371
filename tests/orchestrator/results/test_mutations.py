"""Every kind of file of a sweep, damaged in every way: the results are the same, or something is said; never neither.

Seeded, in this process. DELTATUNE_MUTATIONS=N tries N mutations of each file instead of MUTATIONS.
"""

from __future__ import annotations

import json
import os
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from conftest import timeless

from orchestrator.execution.session import SweepSession
from orchestrator.results import pretrained_names
from orchestrator.results.checked_json import read, write
from orchestrator.results.status import sweep_status
from orchestrator.results.sweep_folder import Results
from search_spaces.search_space import SearchSpace
from tests.orchestrator.local_sweeps import LOCAL, space
from trainables.errors import InputError

MUTATIONS = int(os.environ.get("DELTATUNE_MUTATIONS", "12"))

KINDS = (
    "sweep.json",
    "plan.json",
    "given.json",
    "tables.json",
    "cells.parquet",
    "points.parquet",
    "records/000000.jsonl",
    "driver.log",
    ".progress.json",
)


def flipped(data: bytes, rng: np.random.Generator) -> bytes:
    at, bit = int(rng.integers(len(data))), int(rng.integers(8))
    return data[:at] + bytes([data[at] ^ 1 << bit]) + data[at + 1 :]


def cut(data: bytes, rng: np.random.Generator) -> bytes:
    return data[: int(rng.integers(len(data)))]


def zeroed(data: bytes, rng: np.random.Generator) -> bytes:
    at = int(rng.integers(len(data)))
    return data[:at] + bytes(min(512, len(data) - at)) + data[at + 512 :]


def doubled(data: bytes, rng: np.random.Generator) -> bytes:
    return data + data[int(rng.integers(len(data))) :]


def digit(data: bytes, rng: np.random.Generator) -> bytes:
    """Another number where a number was."""
    places = [at for at, byte in enumerate(data) if chr(byte).isdigit()]
    at = places[int(rng.integers(len(places)))] if places else 0
    return data[:at] + b"7" * int(rng.integers(1, 40)) + data[at + 1 :]


def without_a_key(data: bytes, rng: np.random.Generator) -> bytes:
    """JSON without one of its keys; other files without one of their lines."""
    try:
        parsed = json.loads(data)
        parsed.pop(list(parsed)[int(rng.integers(len(parsed)))])
        return json.dumps(parsed).encode()
    except (ValueError, AttributeError):
        lines = data.splitlines(keepends=True)
        lines.pop(int(rng.integers(len(lines))))
        return b"".join(lines)


def garbage(data: bytes, rng: np.random.Generator) -> bytes:
    return [b"", b"\0", b"[]", b"{}", b"null", b'{"schema": 1}', b"[" * 100_000, b"9" * 5000][int(rng.integers(8))]


WAYS: tuple[Callable[[bytes, np.random.Generator], bytes], ...]
WAYS = (flipped, flipped, cut, zeroed, doubled, digit, without_a_key, garbage)


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Path:
    storage = tmp_path_factory.mktemp("whole")
    swept(storage)
    return storage


def swept(storage: Path, asked: SearchSpace | None = None) -> None:
    with SweepSession.open(storage, "small", asked or space()) as now:
        assert now.run(LOCAL).failed == 0
        now.results.write_tables()


def look(storage: Path) -> tuple[Any, list[str]]:
    """(all that is drawn from a sweep, what is said to be damaged); InputError says it too."""
    results = Results.open(storage, "small")
    status = sweep_status(results)
    cells, points = results.tables()
    drawn = [status["stages"], results.meta(), results.space().to_json(), pretrained_names.options(results.folder)]
    return [*drawn, timeless(cells).to_csv(), timeless(points).to_csv()], status["damage"]


def refused_or_found(storage: Path, kind: str) -> tuple[Any, list[str]]:
    """As `look`, with the sentence of a refusal, which names the file, as what is said."""
    try:
        return look(storage)
    except InputError as error:
        text = str(error)
    assert "\n" not in text
    assert kind in text or "unknown sweep" in text, text
    return None, [text]


@pytest.mark.parametrize("kind", KINDS)
def test_a_damaged_file_changes_no_result_without_a_word_and_the_same_command_mends_it(
    whole: Path, tmp_path: Path, kind: str
) -> None:
    expected, damage = look(whole)
    assert damage == []
    rng = np.random.default_rng([8, KINDS.index(kind)])
    for number in range(MUTATIONS):
        way = WAYS[number % len(WAYS)]
        storage = tmp_path / str(number)
        shutil.copytree(whole, storage)
        path = storage / "small" / kind
        path.write_bytes(way(path.read_bytes(), rng))
        found, damage = refused_or_found(storage, kind)
        assert damage or found == expected, f"{way.__name__} of {kind} changed the results and nothing was said"
        if number < 2 * len(WAYS):
            swept(storage)
            mended, damage = look(storage)
            assert damage == []
            assert mended[4:] == expected[4:], f"{way.__name__} of {kind} was not mended"
        shutil.rmtree(storage)


@pytest.mark.parametrize("kind", KINDS)
def test_a_file_that_is_gone_is_missed_or_made_again(whole: Path, tmp_path: Path, kind: str) -> None:
    expected, _ = look(whole)
    shutil.copytree(whole, tmp_path / "copy")
    (tmp_path / "copy" / "small" / kind).unlink()
    found, damage = refused_or_found(tmp_path / "copy", kind)
    assert damage or found == expected
    swept(tmp_path / "copy")
    assert look(tmp_path / "copy")[0][4:] == expected[4:]


def test_a_folder_of_an_older_version_without_checksums_still_opens(whole: Path, tmp_path: Path) -> None:
    expected, _ = look(whole)
    shutil.copytree(whole, tmp_path / "old")
    folder = tmp_path / "old" / "small"
    for name in ("sweep.json", "plan.json"):
        data = read(folder / name)
        data.pop("created") if name == "plan.json" else None
        (folder / name).write_text(json.dumps(data))
    (folder / "given.json").write_text("[]")
    (folder / "tables.json").unlink()
    assert look(tmp_path / "old") == (expected, [])


def test_a_damaged_sweep_json_keeps_the_sweeps_identity_in_mlflow(whole: Path, tmp_path: Path) -> None:
    shutil.copytree(whole, tmp_path / "copy")
    created = Results.open(whole, "small").meta()["created"]
    (tmp_path / "copy" / "small" / "sweep.json").write_bytes(b"{")
    swept(tmp_path / "copy")
    assert Results.open(tmp_path / "copy", "small").meta()["created"] == created


def test_tables_in_a_folder_that_cannot_be_written_to_are_drawn_elsewhere(
    whole: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from orchestrator.results import checked_json

    expected, _ = look(whole)
    shutil.copytree(whole, tmp_path / "copy")
    (tmp_path / "copy" / "small" / "tables.json").unlink()

    def refused(*words: object, **more: object) -> None:
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr(checked_json, "write", refused)
    assert look(tmp_path / "copy")[0] == expected


def test_what_was_written_reads_back(tmp_path: Path) -> None:
    data = {"schema": 1, "numbers": [0.1, 1e300, -5], "text": "ä\n"}
    write(tmp_path / "x.json", data)
    assert read(tmp_path / "x.json") == data
