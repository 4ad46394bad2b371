"""`deltatune restore`: what is published is in a storage again, and every command that reads a sweep reads it."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from orchestrator.results.sweep_folder import Results
from tests.deltatune.cli.in_process import command

PUBLISHED = Path(__file__).parents[3] / "docs" / "dataset"


@pytest.mark.usefixtures("quick_figures")
def test_a_restored_sweep_can_be_reported_on_at_once_and_has_nothing_left_to_run(tmp_path: Path) -> None:
    code, out, err = command("restore", str(PUBLISHED), "collapse", "--storage", str(tmp_path))
    assert code == 0, err
    assert "collapse: 81 records" in out
    told = json.loads(command("status", "collapse", "--storage", str(tmp_path), "--json")[1])
    stages = {stage: (row["done"], row["missing"]) for stage, row in told["stages"].items()}
    assert stages == {"source": (1, 0), "transfer": (80, 0)}
    code, _, err = command("export", "collapse", "--storage", str(tmp_path), "-o", str(tmp_path / "best.yaml"))
    assert code == 0, err
    code, _, err = command("report", "collapse", "--storage", str(tmp_path))
    assert code == 0, err
    assert "damaged" not in err
    again = command("restore", str(PUBLISHED), "collapse", "--storage", str(tmp_path), "--json")
    assert json.loads(again[1]) == {"collapse": 0}


@pytest.mark.usefixtures("quick_figures")
def test_the_command_that_restore_prints_continues_that_sweep_and_no_larger_one(tmp_path: Path) -> None:
    out = command("restore", str(PUBLISHED), "paper-figure1", "--storage", str(tmp_path))[1]
    words = out.partition("deltatune ")[2].removesuffix(" continues it\n").split()
    assert words == ["sweep", "--name", "paper-figure1", "--storage", str(tmp_path)]
    before = Results.open(tmp_path, "paper-figure1").plan()
    code, out, err = command(*words, "--local", "--no-mlflow", "--json")
    assert code == 0, err
    assert json.loads(out)["tally"]["ran"] == 0
    assert Results.open(tmp_path, "paper-figure1").plan() == before


def test_where_networks_are_ranked_the_plan_ends_with_the_sources(tmp_path: Path) -> None:
    code, _, err = command("restore", str(PUBLISHED), "source-networks", "--storage", str(tmp_path))
    assert code == 0, err
    assert {stage: len(cells) for stage, cells in Results.open(tmp_path, "source-networks").plan().items()} == {
        "source": 5
    }
