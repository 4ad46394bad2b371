"""A published dataset gives every record back to the bit, says what is damaged, and takes a sweep up where it was."""

from __future__ import annotations

import subprocess
from pathlib import Path

import pandas as pd
import pytest
from conftest import SPACE
from hypothesis import given
from hypothesis import strategies as st
from rich.console import Console

from orchestrator.dataset.dataset import CELLS, SUMS, Dataset
from orchestrator.dataset.publication import write
from orchestrator.dataset.rows import cell_row, point_rows, record_of
from orchestrator.execution.replay import replay_published
from orchestrator.execution.sweep import restore, run
from orchestrator.results.records.record import Record
from orchestrator.results.sweep_folder import Results
from search_spaces.loading import parse
from tests.orchestrator.local_sweeps import LOCAL, space
from tests.orchestrator.records import record
from trainables import curve
from trainables.errors import InputError


@pytest.fixture(scope="module")
def swept(tmp_path_factory: pytest.TempPathFactory) -> Results:
    results = Results.create(tmp_path_factory.mktemp("swept"), "small", parse("small", SPACE))
    run(results, LOCAL, Console(quiet=True))
    return results


@pytest.fixture(scope="module")
def dataset(swept: Results, tmp_path_factory: pytest.TempPathFactory) -> Dataset:
    return write(tmp_path_factory.mktemp("published"), [swept], "Made by a test.")


def _same(one: Record, other: Record) -> bool:
    fields = ("cell", "status", "digest", "finished", "seconds", "versions", "commit")
    return all(getattr(one, name) == getattr(other, name) for name in fields) and all(
        one.points[name] == other.points[name] for name in one.points if name != "seconds"
    )


def test_every_record_comes_back_to_the_bit(swept: Results, dataset: Dataset) -> None:
    records = [record for _, _, record in swept.records() if record]
    assert len(records) == len(dataset.cells) > 3
    assert all(_same(record, dataset.record(record.cell.id)) for record in records)
    assert {record.cell.id for record in records} == {record.cell.id for record in dataset.records("small")}


numbers = st.none() | st.floats(allow_nan=False, allow_infinity=False)
wholes = st.none() | st.integers(-(2**53), 2**53)


@given(st.lists(st.tuples(numbers, wholes, numbers), min_size=1, max_size=6))
def test_any_curve_survives_a_parquet_column(rows: list[tuple[float | None, int | None, float | None]]) -> None:
    size = len(rows)
    plain = {name: list(range(size)) for name in ("episode", "step")}
    points = plain | {name: [float(i) for i in range(size)] for name in curve.FIELDS if name not in plain}
    points |= {"share": [row[0] for row in rows], "count": [row[1] for row in rows], "rest": [row[2] for row in rows]}
    made = record(1).model_copy(update={"points": points, "digest": curve.digest(points)})
    frame = pd.concat([point_rows(made), point_rows(record(2))])  # a second cell, which has no count
    row = pd.Series(cell_row("x", made))
    assert _same(made, record_of(row, frame[frame["cell_id"] == made.cell.id]))


def test_a_curve_that_mixes_whole_numbers_and_fractions_is_refused() -> None:
    mixed = record(1).model_copy(update={"points": record(1).points | {"x": [1, 0.5]}})
    with pytest.raises(InputError, match="column 'x' mixes whole numbers and fractions"):
        cell_row("x", mixed)


def test_the_checksums_are_those_of_sha256sum(dataset: Dataset) -> None:
    subprocess.run(["sha256sum", "--quiet", "-c", SUMS], cwd=dataset.folder, check=True)


@pytest.mark.parametrize("name", [CELLS, "points/small.parquet", "README.md", "spaces/small.json"])
def test_a_damaged_or_missing_file_is_named(dataset: Dataset, tmp_path: Path, name: str) -> None:
    copy = tmp_path / "copy"
    for path in (path for path in dataset.folder.rglob("*") if path.is_file()):
        there = copy / path.relative_to(dataset.folder)
        there.parent.mkdir(parents=True, exist_ok=True)
        there.write_bytes(path.read_bytes())
    data = bytearray((copy / name).read_bytes())
    data[len(data) // 2] ^= 1
    (copy / name).write_bytes(data)
    with pytest.raises(InputError, match=f"{name} is missing or damaged"):
        Dataset(copy)
    (copy / name).unlink()
    with pytest.raises(InputError, match=f"{name} is missing or damaged"):
        Dataset(copy)


def test_another_sweep_joins_and_an_older_state_is_replaced(dataset: Dataset, swept: Results, tmp_path: Path) -> None:
    results = Results.create(tmp_path / "storage", "one", space())
    run(results, LOCAL, Console(quiet=True))
    joint = write(tmp_path / "joint", [swept])
    joint = write(tmp_path / "joint", [results])
    assert joint.sweeps() == ["one", "small"]
    cells = len(joint.cells)
    joint = write(tmp_path / "joint", [swept, results])
    assert len(joint.cells) == cells
    other = write(tmp_path / "both", [results, swept])
    assert _bits(joint).equals(_bits(other))


def _bits(dataset: Dataset) -> pd.DataFrame:
    points = dataset.points()
    return points[sorted(set(points) - {"seconds"})]


def test_a_sweep_goes_on_from_what_was_published(swept: Results, dataset: Dataset, tmp_path: Path) -> None:
    assert restore(dataset, "small", tmp_path) == len(dataset.cells)
    assert restore(dataset, "small", tmp_path) == 0
    restored = Results.open(tmp_path, "small")
    summary = run(restored, LOCAL, Console(quiet=True))
    assert summary.ran == 0, "what the sources have learned is not published, and nothing needs it"
    mine, theirs = restored.tables()[0], swept.tables()[0]
    assert mine["auc"].equals(theirs["auc"])


def test_a_published_cell_is_trained_again_with_its_source(dataset: Dataset, tmp_path: Path) -> None:
    transferred = dataset.cells[dataset.cells["source_cell"].notna()].iloc[0]
    found = replay_published(dataset, transferred["cell_id"], tmp_path)
    assert found.agrees
    assert found.sweep == "small"
    assert not list(tmp_path.iterdir())


def test_what_is_not_there_is_said(dataset: Dataset, tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no cell 0123456789abcdef in"):
        replay_published(dataset, "0123456789abcdef", tmp_path)
    with pytest.raises(InputError, match=r"unknown sweep in .* 'other'"):
        dataset.space("other")
    with pytest.raises(InputError, match="is not a dataset"):
        Dataset(tmp_path)
    (tmp_path / "mine.txt").write_text("x")
    with pytest.raises(InputError, match="is not empty, and not a dataset"):
        write(tmp_path, [])
