"""A refactoring changes neither the id of a cell nor a bit of its curve."""

from __future__ import annotations

import golden_cells
import pytest

from trainables.agents.registry import AGENTS
from trainables.cell import Cell
from trainables.tasks.registry import families

RECORDED = golden_cells.recorded()
CELLS = golden_cells.cells()
BY_CONTENT = ("fading_advice/exact",)
"""Their ids follow from a file that may change."""


@pytest.fixture(scope="module")
def digests() -> dict[str, dict[str, str]]:
    return dict(golden_cells.digests())


def test_every_agent_and_family_has_a_cell() -> None:
    assert set(RECORDED) == set(CELLS)
    assert {cell.agent for cell in CELLS.values()} >= set(AGENTS)
    assert {cell.task.partition(":")[0] for cell in CELLS.values()} >= {*families(), "gym"}


@pytest.mark.parametrize("name", [name for name in RECORDED if name not in BY_CONTENT])
def test_the_id_is_the_same(name: str) -> None:
    assert CELLS[name].to_json() == RECORDED[name]["cell"]
    assert CELLS[name].id == RECORDED[name]["id"]
    assert Cell.from_json(RECORDED[name]["cell"]).id == RECORDED[name]["id"]


@pytest.mark.parametrize("name", RECORDED)
def test_every_bit_of_the_curve_is_the_same(name: str, digests: dict[str, dict[str, str]]) -> None:
    assert digests[name] == {column: RECORDED[name][column] for column in ("curve", "whole")}
