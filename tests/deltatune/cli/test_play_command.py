"""`deltatune play`: a cell's agent beside its source, and a source's file."""

from __future__ import annotations

import json
from pathlib import Path

import pandas as pd
import pytest
from typer.testing import CliRunner

from deltatune.cli.main import app
from trainables.errors import InputError


def played(storage: Path, *words: str) -> dict[str, object]:
    result = CliRunner().invoke(app, ["play", *words, "--storage", str(storage), "--json"], catch_exceptions=False)
    assert result.exit_code == 0
    data: dict[str, object] = json.loads(result.stdout)
    return data


def test_an_agent_is_played_as_it_was_evaluated_last_beside_its_source(finished: Path, tmp_path: Path) -> None:
    cells = pd.read_parquet(finished / "small" / "cells.parquet")
    cell = cells[(cells.agent == "policy_reuse") & (cells.source == "exact")].iloc[0]
    picture = tmp_path / "end.png"
    data = played(finished, cell.cell_id, "-o", str(picture))
    agent, source = data["episodes"]  # type: ignore[misc]
    assert picture.stat().st_size > 5000
    assert data["task"] == cell.task
    assert agent["title"] == f"policy_reuse, seed {cell.seed}"
    assert source["title"] == "exact source: windy_gridworld"
    assert agent["return"] == source["return"]  # it always follows its source


def test_a_source_is_played_on_another_task(finished: Path, tmp_path: Path) -> None:
    file = next((finished / "sources").glob("*.npz"))
    data = played(finished, str(file), "--task", "windy_gridworld:wind=small", "-o", str(tmp_path / "end.png"))
    assert data["task"] == "windy_gridworld:wind=small"


def test_a_source_of_another_shape_and_an_unknown_cell_are_refused(finished: Path, tmp_path: Path) -> None:
    file = next((finished / "sources").glob("*.npz"))
    for words, sentence in (
        ([str(file), "--task", "cartpole"], "does not fit cartpole"),
        (["0" * 16], "no record of the cell"),
        ([str(file), "-o", "film.avi"], "a film is a .gif"),
    ):
        with pytest.raises(InputError, match=sentence):
            CliRunner().invoke(
                app, ["play", *words, "--storage", str(finished)], catch_exceptions=False, standalone_mode=False
            )
