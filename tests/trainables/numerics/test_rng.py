"""Random streams: one per role, task and seed, and the same on every machine."""

from __future__ import annotations

import itertools
from typing import get_args

import pytest

from trainables.numerics.rng import Role, stream

ROLES: tuple[Role, ...] = get_args(Role)


def test_no_two_roles_tasks_or_seeds_share_a_stream() -> None:
    keys = list(itertools.product((0, 1, 2), ROLES, ("windy_gridworld", "windy_gridworld:wind=small")))
    draws = [tuple(stream(*key).integers(0, 2**63, 4)) for key in keys]
    assert len(set(itertools.chain(*draws))) == 4 * len(keys) == 168


def test_a_stream_always_starts_at_its_beginning_and_no_other_moves_it() -> None:
    first = stream(0, "exploration", "supply_chain")
    values = first.random(5).tolist()
    stream(0, "evaluation_env", "supply_chain").random(1000)
    assert stream(0, "exploration", "supply_chain").random(5).tolist() == values
    assert first.random() != values[0]


@pytest.mark.parametrize(
    ("seed", "role", "task", "draw"),
    [
        (0, "training_env", "windy_gridworld", 0.5698674337334569),
        (0, "exploration", "windy_gridworld", 0.5151256282113589),
        (4, "training_env", "supply_chain:demand_mean=5", 0.1663565354230676),
    ],
)
def test_the_first_draw_is_what_it_was_when_the_first_results_were_written(seed, role, task, draw) -> None:
    assert stream(seed, role, task).random() == draw
