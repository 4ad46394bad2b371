"""The registry of built-in search spaces: each can be built, and every cell of its plan created."""

from __future__ import annotations

import pytest
import yaml

from orchestrator.planning.plan import source_arms, transfer_arms
from orchestrator.planning.source_choice import settle, untrained
from search_spaces.domains import Grid
from search_spaces.loading import built_in, load, parse
from search_spaces.search_space import SearchSpace
from trainables.cell import Cell


def _plan(space: SearchSpace) -> tuple[list[Cell], list[Cell]]:
    """The cells of both stages, as if the first configuration of each source were the best."""
    sources = source_arms(space, {})
    transfers = transfer_arms(space, settle(sources, {}, lambda arm: untrained(arm, steps=1000)), {})
    return (
        list({cell.id: cell for arms in sources for arm in arms.values() for cell in arm.all_cells()}.values()),
        list({cell.id: cell for arm in transfers for cell in arm.all_cells()}.values()),
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
