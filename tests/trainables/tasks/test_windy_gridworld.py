"""Windy Gridworld: the winds of Table 2, and the order of what happens inside a step."""

from __future__ import annotations

import json
import re

import numpy as np
import pytest

from trainables.tasks.builtin import windy_gridworld
from trainables.tasks.builtin.windy_gridworld import WINDS
from trainables.tasks.builtin.windy_gridworld_model import DOWN, LEFT, RIGHT, SIZE, UP, land, step
from trainables.tasks.make import make_env
from trainables.tasks.registry import parse_task

TABLE_2 = """
Small changes in wind	[0, 0, -1, 1, 1, 1, 2, 2, 1, 0, 0, 0, 0, 1, 1, 1, 2, 2, 1, 0]
Wind Direction Reversed	[0, 0, 0, -1, -1, -1, -2, -2, -1, 0, 0, 0, 0, -1, -1, -1, -2, -2, -1, 0]
Additional Transfer Scenario 1	[0, 1, 1, 1, 2, 1, -1, 1, -1, 0, 0, 1, 1, 1, 2, 1, -1, 1, -1, 0]
Additional Transfer Scenario 2	[0, 1, -1, 1, 1, 1, -2, 2, 1, 0, 0, 1, -1, 1, 1, 1, -2, 2, 1, 0]
"""
"""The paper's Table 2, as it is printed."""


def _printed(text: str) -> list[tuple[int, ...]]:
    return [tuple(json.loads(line)) for line in re.findall(r"\t(\[[-\d, ]+\])", text)]


def test_the_grid_has_a_wind_for_each_of_its_columns() -> None:
    assert windy_gridworld.SIZE == SIZE


def test_the_winds_are_those_of_table_2() -> None:
    assert _printed(TABLE_2) == [WINDS[name] for name in ("small", "reversed", "additional_1", "additional_2")]


def test_the_source_wind_is_the_negative_of_the_reversed_one() -> None:
    assert parse_task("windy_gridworld").context["wind"] == tuple(-strength for strength in WINDS["reversed"])


# In the source wind: columns 2, 3, 4 have wind 0, 1, 1 and columns 5, 6 have 1, 2.
STEPS = {
    "no wind, up": ((10, 0), UP, (9, 0)),
    "no wind, down": ((10, 1), DOWN, (11, 1)),
    "wind pushes up": ((10, 6), LEFT, (8, 5)),
    "departure column has no wind, arrival has": ((10, 2), RIGHT, (10, 3)),
    "departure column has wind, arrival has none": ((10, 3), LEFT, (9, 2)),
    "departure column has less than arrival": ((10, 5), RIGHT, (9, 6)),
    "wind then clip then move would give row 1": ((0, 3), DOWN, (0, 3)),
    "wind then clip then move would give row 1 from row 1": ((1, 6), DOWN, (0, 6)),
    "move then clip then wind would give row 17": ((19, 6), DOWN, (18, 6)),
    "the top holds": ((1, 6), UP, (0, 6)),
    "the left edge holds": ((5, 0), LEFT, (5, 0)),
    "the right edge holds": ((5, 19), RIGHT, (5, 19)),
    "the bottom holds": ((19, 19), DOWN, (19, 19)),
}


@pytest.mark.parametrize(("cell", "move", "expected"), STEPS.values(), ids=STEPS)
def test_a_step_adds_the_move_and_the_departure_columns_wind_and_clips_once(cell, move, expected) -> None:
    state, next_state = cell[0] * SIZE + cell[1], expected[0] * SIZE + expected[1]
    task = parse_task("windy_gridworld")
    assert land(state, move, task.dynamics().parameters) == next_state
    row = task.model().transitions[[state * 4 + move]].toarray()[0]
    assert row.argmax() == next_state
    assert row.max() >= 0.8125 - 1e-12


def test_the_intended_move_is_executed_with_probability_13_16() -> None:
    dynamics, rng, draws = parse_task("windy_gridworld").dynamics(), np.random.default_rng(0), 40_000
    centre = 10 * SIZE + 10  # a column without wind: four different cells
    ends = {UP: centre - SIZE, DOWN: centre + SIZE, LEFT: centre - 1, RIGHT: centre + 1}
    for action in (UP, RIGHT):
        landed = np.array([step(centre, action, dynamics.parameters, rng)[0] for _ in range(draws)])
        for move, end in ends.items():
            p = 0.8125 if move == action else 0.0625
            assert abs(np.mean(landed == end) - p) < 5 * np.sqrt(p * (1 - p) / draws)


def test_every_step_costs_1_the_one_into_the_goal_included_and_only_the_goal_ends_the_episode() -> None:
    dynamics, rng = parse_task("windy_gridworld").dynamics(), np.random.default_rng(0)
    beside = 17 * SIZE + 15  # column 15 has wind 1, so left from (18, 15) lands on the goal (17, 14)
    outcomes = {step(beside + SIZE, LEFT, dynamics.parameters, rng) for _ in range(300)}
    assert {reward for _, reward, _ in outcomes} == {-1.0}
    assert {state for state, _, terminated in outcomes if terminated} == {17 * SIZE + 14}
    assert any(not terminated for _, _, terminated in outcomes)


def test_start_and_goal_move_with_their_features() -> None:
    task = parse_task("windy_gridworld:start=[5,6],goal=[7,8]")
    assert make_env(task).reset(seed=0)[0] == 5 * SIZE + 6
    assert list(np.flatnonzero(task.model().terminal)) == [7 * SIZE + 8]
