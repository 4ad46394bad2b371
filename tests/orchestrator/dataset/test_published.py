"""The dataset of this repository: whole, small, and its rows come out again to the bit."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from orchestrator.dataset.dataset import Dataset
from orchestrator.execution.replay import replay_published

FOLDER = Path(__file__).parents[3] / "docs" / "dataset"


@pytest.fixture(scope="module")
def dataset() -> Dataset:
    return Dataset(FOLDER)


def test_it_is_at_most_30_mb(dataset: Dataset) -> None:
    assert sum(path.stat().st_size for path in FOLDER.rglob("*") if path.is_file()) < 30e6


def test_the_cheapest_ten_of_different_agents_and_targets_come_out_again(dataset: Dataset, tmp_path: Path) -> None:
    kinds = dataset.cells.sort_values(["seconds", "cell_id"]).drop_duplicates(["agent", "task", "source"])
    cheapest = list(kinds["cell_id"][:10])
    assert len(cheapest) == 10
    assert [replay_published(dataset, cell, tmp_path).agrees for cell in cheapest] == [True] * 10


def test_every_source_of_a_published_cell_is_published(dataset: Dataset) -> None:
    cells = [json.loads(cell) for cell in dataset.cells["cell"]]
    sources = {s["cell_id"] for c in cells for s in (c["source"], *c.get("library", ())) if s and s["cell_id"]}
    assert sources <= set(dataset.cells["cell_id"])
