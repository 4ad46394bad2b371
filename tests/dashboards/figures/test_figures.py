"""The figures are drawn from the results table, and show what is in it."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest
from matplotlib.image import imread

from dashboards.draw import draw
from dashboards.style import MARKERS, look
from orchestrator.analysis.findings import find
from orchestrator.results.sweep_folder import Results
from trainables.agents.registry import AGENTS


@pytest.fixture
def results(finished: Path, tmp_path: Path) -> Results:
    shutil.copytree(finished, tmp_path / "r")
    return Results.open(tmp_path / "r", "small")


@pytest.fixture(scope="module")
def drawn(finished: Path, tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    """The figures of the finished sweep."""
    storage = tmp_path_factory.mktemp("drawn") / "r"
    shutil.copytree(finished, storage)
    return pictures(Results.open(storage, "small"))


def pictures(results: Results) -> list[Path]:
    return draw(find(results))[1:]


def test_each_figure_is_a_png_and_an_svg_with_the_targets_and_agents_in_it(drawn: list[Path]) -> None:
    paths = drawn
    names = ("curves", "delta_effect", "matrix")
    assert sorted(path.name for path in paths) == [f"{name}.{end}" for name in names for end in ("png", "svg")]
    for path in paths:
        if path.suffix == ".png":
            assert imread(path).std() > 0.05
    text = next(path for path in paths if path.name == "curves.svg").read_text()
    for shown in ("wind=small", "wind=reversed", "learned source", "exact source", "delta_gate", "q_learning"):
        assert shown in text


def test_the_same_results_give_the_same_bytes(results: Results, drawn: list[Path]) -> None:
    assert [path.read_bytes() for path in pictures(results)] == [path.read_bytes() for path in drawn]


def test_a_sweep_without_a_complete_cell_draws_nothing(results: Results) -> None:
    cells, points = results.tables()
    assert draw(find(results, (cells.assign(status="missing", auc=None), points)))[1:] == []


def test_a_sweep_without_transfer_has_curves_alone(results: Results) -> None:
    plan = results.plan()
    plan["transfer"] = [cell for cell in plan["transfer"] if cell.agent == "q_learning"]
    results.set_plan(plan)
    assert {path.stem for path in pictures(results)} == {"curves"}


def test_every_agent_has_a_look_of_its_own_among_its_kind() -> None:
    for kind in ("tabular", "deep"):
        looks = [look(agent.name) for agent in AGENTS.values() if agent.kind == kind]
        for colour in ("light", "dark"):
            assert len({(getattr(look, colour), look.dash) for look in looks}) == len(looks) > 1
            assert len({(getattr(look, colour), look.marker) for look in looks}) == len(looks)
        assert all(look.marker in MARKERS for look in looks)
