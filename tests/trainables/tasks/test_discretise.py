"""Continuous actions cut into levels: which they are, and that the environment gets exactly those."""

from __future__ import annotations

from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium.spaces import Box

from trainables.errors import InputError
from trainables.tasks.builtin.reacher_env import TORQUES
from trainables.tasks.env_checker import rollout
from trainables.tasks.make import make_env
from trainables.tasks.registry import parse_task
from trainables.tasks.wrappers.discretise import action_table, discretise


def test_the_levels_are_even_from_bound_to_bound_and_every_combination_is_an_action() -> None:
    table = action_table(Box(np.array([-1, 0], np.float32), np.array([1, 10], np.float32)), 3)
    assert table.tolist() == [[x, y] for x in (-1, 0, 1) for y in (0, 5, 10)]
    assert table.dtype == np.float32


def test_reachers_nine_torques_are_three_levels() -> None:
    assert TORQUES.tolist() == [[x, y] for x in (-1, 0, 1) for y in (-1, 0, 1)]


@pytest.mark.parametrize(
    ("name", "count"),
    [("Pendulum-v1", 5), ("MountainCarContinuous-v0", 5), ("InvertedPendulum-v5", 5), ("Reacher-v5", 25)],
)
def test_the_environment_gets_the_action_that_a_number_stands_for(name: str, count: int) -> None:
    ours, plain = make_env(parse_task(f"gym:{name}:levels=5")), gymnasium.make(name)
    table = action_table(plain.action_space, 5)
    assert len(table) == count == ours.action_space.n  # type: ignore[attr-defined]
    ours.reset(seed=1)
    plain.reset(seed=1)
    for action in np.random.default_rng(0).integers(0, count, 30):
        seen: list[Any] = [ours.step(int(action)), plain.step(table[action])]
        assert seen[0][0].tobytes() == seen[1][0].tobytes()
        assert seen[0][1] == seen[1][1]


def test_a_names_levels_and_attributes_go_together() -> None:
    task = parse_task("gym:Pendulum-v1:g=2x,levels=7")
    assert task.name == "gym:Pendulum-v1:levels=7,g=20"
    assert make_env(task).unwrapped.g == 20  # type: ignore[attr-defined]
    assert parse_task("gym:Pendulum-v1:levels=3").name == "gym:Pendulum-v1"
    assert rollout(make_env(task), 50) != rollout(make_env(parse_task("gym:Pendulum-v1:levels=7")), 50)


def test_the_time_limit_stays_outermost() -> None:
    env = discretise(gymnasium.make("Pendulum-v1", max_episode_steps=2), 3)
    env.reset(seed=0)
    assert [env.step(1)[3] for _ in range(2)] == [False, True]


@pytest.mark.parametrize(
    ("space", "levels", "says"),
    [
        (Box(-np.inf, np.inf, (1,)), 3, "actions without bounds"),
        (Box(-1, 1, (7,)), 3, "levels=3 in 7 dimensions are 2187 actions, more than 1024: levels=2 are 128"),
        (Box(-1, 1, (11,)), 2, "2048 actions, more than 1024: there are too many dimensions"),
        (gymnasium.spaces.MultiDiscrete([2, 2]), 3, "only Discrete and Box actions"),
    ],
)
def test_what_cannot_be_cut_is_refused(space: Any, levels: int, says: str) -> None:
    with pytest.raises(InputError, match=says):
        action_table(space, levels)
