"""The registry of built-in search spaces: each can be built, and every cell of its plan created."""

from __future__ import annotations

from dataclasses import replace

import pytest
import yaml

from orchestrator.planning.arms import Pair
from orchestrator.planning.plan import library_pairs, source_pairs, transfer_pairs
from orchestrator.planning.source_choice import SourceChoice, SourceRun
from search_spaces.domains import Grid
from search_spaces.loading import built_in, load, parse
from search_spaces.search_space import SearchSpace
from trainables.cell import Cell


def _source_choice(pair: Pair) -> SourceChoice:
    """Stage 1's outcome as if its first configuration were the best."""
    values = pair.grid[0]
    return SourceChoice(values, {cell.seed: SourceRun(cell, 0.0, 0.0, 1000) for cell in pair.cells(values)})


def _plan(space: SearchSpace) -> tuple[list[Cell], list[Cell]]:
    pairs = [pair for pair in source_pairs(space, {}) if pair is not None]
    libraries = [[pair for pair in library if pair is not None] for library in library_pairs(space, {})]
    choices = [
        replace(_source_choice(pair), library=tuple(_source_choice(other) for other in library))
        for pair, library in zip(pairs, libraries, strict=True)
    ]
    transfers = transfer_pairs(space, choices, {})
    pairs = [*pairs, *(pair for library in libraries for pair in library)]
    return (
        list({cell.id: cell for pair in pairs for cell in pair.all_cells()}.values()),
        list({cell.id: cell for pair in transfers for cell in pair.all_cells()}.values()),
    )


# 4 learning rates x 5 seeds, then targets x 5 seeds x (agents with their own grids, those with a source twice)
SIZES = {
    "demo": (20, 2 * 5 * (1 + 2 * 3)),
    "paper-gridworld": (20, 2 * 5 * (1 + 2 * (1 + 4 + 2 + 1 + 1))),
    "paper-supply-chain": (20, 2 * 5 * (1 + 2 * (1 + 4 + 1 + 1 + 1))),
    "paper-figure1": (20, 5 * 5 * (1 + 2)),
}


def test_the_spaces_that_the_readme_names_are_there() -> None:
    assert set(built_in()) >= set(SIZES)


@pytest.mark.parametrize("name", sorted(built_in()))
def test_every_cell_of_every_built_in_space_can_be_created(name: str) -> None:
    sources, transfers = _plan(load(name))
    assert load(name).name == name
    assert all(Cell.from_json(cell.to_json()) == cell for cell in (*sources, *transfers))
    if name in SIZES:
        assert (len(sources), len(transfers)) == SIZES[name]


@pytest.mark.parametrize("name", sorted(built_in()))
def test_a_space_comes_back_from_json_and_from_yaml_as_it_was(name: str) -> None:
    space = load(name)
    assert parse(name, space.to_json()) == space
    assert parse(name, yaml.safe_load(yaml.safe_dump(space.to_json()))) == space


@pytest.mark.parametrize("name", [name for name in built_in() if name.startswith("paper-")])
def test_a_space_of_the_paper_has_its_seeds_and_says_where_its_numbers_come_from(name: str) -> None:
    space = load(name)
    assert space.seeds == (0, 1, 2, 3, 4)
    assert all(isinstance(option, Grid) and option.paper for option in space.hyperparameters.values())


def test_the_values_of_tables_4_and_5_reach_the_cells() -> None:
    gridworld, chain = (_plan(load(name))[1] for name in ("paper-gridworld", "paper-supply-chain"))
    table_4 = {"gamma": 0.99, "epsilon_start": 0.1, "epsilon_decay": 5e-4}
    assert all(table_4.items() <= cell.hyperparameters.items() for cell in (*gridworld, *chain))
    assert {cell.hyperparameters["episodes"] for cell in gridworld} == {5000}
    assert {cell.hyperparameters["episodes"] for cell in chain} == {1000}
    assert {c.hyperparameters["threshold"] for c in chain if c.agent == "delta_gate"} == {5.0}
    assert {c.hyperparameters["threshold"] for c in gridworld if c.agent == "delta_gate"} == {10.0, 3.0}
    assert {c.hyperparameters["nu"] for c in gridworld if c.agent == "ppr"} == {0.99, 0.9, 0.8, 0.7}
