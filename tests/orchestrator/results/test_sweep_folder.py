"""Records on disk: whole or refused, never half-read; the tables are drawn up from them."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from conftest import CELLS, SPACE, record_lines, set_record_lines

from deltatune.publish import publish
from orchestrator.results import sweep_folder
from orchestrator.results.sweep_folder import Results
from orchestrator.sources.library import SourceLibrary
from search_spaces.loading import parse
from trainables.cell import Cell
from trainables.errors import InputError
from trainables.knowledge import Knowledge


@pytest.fixture
def copy(finished: Path, tmp_path: Path) -> Results:
    """A finished sweep that may be damaged."""
    shutil.copytree(finished, tmp_path / "copy")
    return Results.open(tmp_path / "copy", "small")


@pytest.mark.parametrize("cell_id", ["../../etc/passwd", "", "abc", "0123456789ABCDEF", "0" * 17])
def test_a_cell_id_cannot_leave_the_folder(copy: Results, cell_id: str) -> None:
    with pytest.raises(InputError, match="16 hexadecimal digits"):
        copy.record(cell_id)
    with pytest.raises(InputError, match="16 hexadecimal digits"):
        SourceLibrary(copy.storage).load(cell_id)


@pytest.mark.usefixtures("quick_figures")
def test_a_search_space_is_checked_once_however_often_it_is_asked_for(
    copy: Results, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Each check of a custom task builds its environments."""
    checked: list[object] = []
    monkeypatch.setattr(sweep_folder, "parse", lambda name, data: checked.append(data) or parse(name, data))
    publish(copy)
    assert copy.space() is copy.space()
    assert len(checked) == 1
    Results.create(copy.storage, "small", parse("small", SPACE | {"seeds": 1}))
    assert len(copy.space().seeds) == 1


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
    gone, *lines = record_lines(copy)
    set_record_lines(copy, lines)
    cells, _ = Results.open(copy.storage, "small").tables()
    row = cells.set_index("cell_id").loc[gone.split(b"\t")[1].decode()]
    assert row["status"] == "missing"
    assert pd.isna(row["auc"])
    assert len(cells) == CELLS


def test_tables_that_are_older_than_a_record_are_drawn_up_anew(copy: Results) -> None:
    before, _ = copy.write_tables()
    record = copy.record(before["cell_id"][0])
    assert record is not None
    copy.add(record.model_copy(update={"status": "failed", "error": "test"}))
    cells, points = copy.tables()
    assert list(cells["status"]) == ["failed", *(["done"] * (CELLS - 1))]
    pd.testing.assert_frame_equal(Results.open(copy.storage, "small").tables()[1], points)


def test_an_unknown_sweep_is_refused_with_the_nearest(copy: Results) -> None:
    with pytest.raises(InputError, match="did you mean 'small'"):
        Results.open(copy.storage, "smal")


def test_the_library_keeps_what_a_source_cell_learned(copy: Results) -> None:
    library = SourceLibrary(copy.storage)
    source = next(s for cell in copy.plan()["transfer"] for s in cell.sources if s.kind == "learned")
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
