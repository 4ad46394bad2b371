"""Records on disk: whole or refused, never half-read; the tables are drawn up from them."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from conftest import CELLS, SPACE

from orchestrator.results import Results
from orchestrator.source_library import SourceLibrary
from search_spaces import parse
from trainables.cell import Cell
from trainables.errors import InputError
from trainables.knowledge import Knowledge


@pytest.fixture
def copy(finished: Path, tmp_path: Path) -> Results:
    """A finished sweep that may be damaged."""
    shutil.copytree(finished, tmp_path / "copy")
    return Results.open(tmp_path / "copy", "small")


def one_record(results: Results) -> Path:
    return sorted((results.folder / "cells").glob("*.json"))[0]


def test_every_record_reads_back_with_its_bits(copy: Results) -> None:
    for path in (copy.folder / "cells").glob("*.json"):
        record = copy.record(path.stem)
        assert record is not None
        assert record.to_bytes() == path.read_bytes()


@pytest.mark.parametrize("damage", ["half", "digit", "empty", "other", "schema"])
def test_a_damaged_record_is_named_and_never_taken_for_a_whole_one(copy: Results, damage: str) -> None:
    path = one_record(copy)
    text = path.read_text()
    data = json.loads(text)
    if damage == "digit":
        data["points"]["greedy_return"][3] += 1e-9
    if damage == "schema":
        data["schema"] = 99
    whole = {"half": text[: len(text) // 2], "empty": "", "other": sorted(path.parent.glob("*.json"))[1].read_text()}
    path.write_text(whole.get(damage, json.dumps(data)))
    with pytest.raises(InputError, match=f"{path.name} is damaged .* run the sweep again"):
        copy.record(path.stem)


@pytest.mark.parametrize("cell_id", ["../../etc/passwd", "", "abc", "0123456789ABCDEF", "0" * 17])
def test_a_cell_id_cannot_leave_the_folder(copy: Results, cell_id: str) -> None:
    with pytest.raises(InputError, match="16 hexadecimal digits"):
        copy.record(cell_id)
    with pytest.raises(InputError, match="16 hexadecimal digits"):
        SourceLibrary(copy.storage).load(cell_id)


@pytest.mark.parametrize("name", ["../x", "", "a/b", ".hidden", "x" * 65])
def test_a_sweep_name_cannot_leave_the_storage_folder(tmp_path: Path, name: str) -> None:
    with pytest.raises(InputError, match="name must be"):
        Results.create(tmp_path, name, parse("small", SPACE))


def test_another_search_space_does_not_mix_in(copy: Results) -> None:
    with pytest.raises(InputError, match="belongs to the search space 'small'"):
        Results.create(copy.storage, "small", parse("x", SPACE | {"name": "other"}))


def test_a_folder_that_cannot_be_written_to_is_refused(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(InputError, match="cannot write to the folder"):
        Results.create(tmp_path / "file", "x", parse("small", SPACE))


def test_the_tables_have_a_row_per_cell_and_per_evaluation(copy: Results) -> None:
    cells, points = copy.write_tables()
    assert len(cells) == CELLS
    assert cells["cell_id"].is_unique
    assert len(points) == CELLS * 7
    assert not points.duplicated(["cell_id", "episode"]).any()
    mean = points.groupby("cell_id")["greedy_return"].mean()
    assert np.allclose(cells.set_index("cell_id")["auc"], mean[cells["cell_id"]])


def test_the_tables_on_disk_are_those_of_the_records(copy: Results) -> None:
    written = copy.write_tables()
    for table, name in zip(written, ("cells", "points"), strict=True):
        pd.testing.assert_frame_equal(pd.read_parquet(copy.folder / f"{name}.parquet"), table, check_dtype=False)


def test_a_missing_record_is_a_row_of_its_own_without_an_auc(copy: Results) -> None:
    path = one_record(copy)
    path.unlink()
    cells, _ = copy.tables()
    row = cells.set_index("cell_id").loc[path.stem]
    assert row["status"] == "missing"
    assert pd.isna(row["auc"])
    assert len(cells) == CELLS


def test_an_unknown_sweep_is_refused_with_the_nearest(copy: Results) -> None:
    with pytest.raises(InputError, match="did you mean 'small'"):
        Results.open(copy.storage, "smal")


def test_the_library_keeps_what_a_source_cell_learned(copy: Results) -> None:
    library = SourceLibrary(copy.storage)
    source = next(cell for cell in copy.plan()["transfer"] if cell.source and cell.source.kind == "learned").source
    assert source is not None
    assert source.cell_id is not None
    assert library.load(source.cell_id).q_table((400, 4)).min() < -1


@pytest.mark.parametrize("offset", [100, -200])
def test_a_library_file_with_one_changed_byte_is_refused(copy: Results, offset: int) -> None:
    path = sorted((copy.storage / "sources").glob("*.npz"))[0]
    data = bytearray(path.read_bytes())
    data[offset] ^= 1
    path.write_bytes(bytes(data))
    with pytest.raises(InputError, match="run the sweep again"):
        SourceLibrary(copy.storage).load(path.stem)


def test_a_library_file_under_anothers_name_is_refused(tmp_path: Path) -> None:
    library = SourceLibrary(tmp_path)
    mine, other = (Cell.create("q_learning", "windy_gridworld", seed) for seed in (0, 1))
    library.save(mine, Knowledge({"q": np.ones((400, 4))}))
    library.path(mine.id).rename(library.path(other.id))
    with pytest.raises(InputError, match="another cell"):
        library.load(other.id)
