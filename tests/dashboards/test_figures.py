"""The figures are drawn from the results table, and show what is in it."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest
from matplotlib.image import imread

from dashboards import draw
from dashboards.style import COLOURS
from orchestrator.results import Results
from trainables.agents import AGENTS


@pytest.fixture
def results(finished: Path, tmp_path: Path) -> Results:
    shutil.copytree(finished, tmp_path / "r")
    return Results.open(tmp_path / "r", "small")


def test_each_figure_is_a_png_and_an_svg_with_the_targets_and_agents_in_it(results: Results) -> None:
    paths = draw(results)
    assert sorted(path.name for path in paths) == [
        "curves.png",
        "curves.svg",
        "reuse_against_delta.png",
        "reuse_against_delta.svg",
    ]
    for path in paths:
        if path.suffix == ".png":
            assert imread(path).std() > 0.05
    text = (results.folder / "figures" / "curves.svg").read_text()
    for shown in (
        "wind=small",
        "wind=reversed",
        "learned source",
        "exact source",
        "delta_gate",
        "q_learning",
        "2 seeds",
    ):
        assert shown in text


def test_the_same_results_give_the_same_bytes(results: Results) -> None:
    first = [path.read_bytes() for path in draw(results)]
    assert [path.read_bytes() for path in draw(results)] == first


def test_a_sweep_without_a_complete_cell_draws_nothing(results: Results) -> None:
    for path in (results.folder / "cells").glob("*.json"):
        path.unlink()
    assert draw(results) == []


def test_a_sweep_without_direct_reuse_has_no_figure_of_it(results: Results) -> None:
    plan = results.plan()
    plan["transfer"] = [cell for cell in plan["transfer"] if cell.agent != "policy_reuse"]
    results.set_plan(plan)
    assert {path.stem for path in draw(results)} == {"curves"}


def test_every_agent_has_a_colour_of_its_own_among_its_kind() -> None:
    for kind in ("tabular", "deep"):
        colours = [COLOURS[agent.name] for agent in AGENTS.values() if agent.kind == kind]
        assert len(set(colours)) == len(colours) > 1
