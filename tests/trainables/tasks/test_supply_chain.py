"""The supply chain: one step by hand, and the model row by row against a second, plain implementation."""

from __future__ import annotations

import math

import numpy as np
import pytest

from trainables.tasks.builtin.supply_chain_model import settle, step
from trainables.tasks.make import make_env
from trainables.tasks.registry import model_of, parse_task


def _state(factory: int, warehouse: int) -> int:
    return factory * 51 + warehouse


# (factory, warehouse), (ship, produce), sold -> (factory', warehouse'), reward
STEPS = {
    "nothing happens but storage": ((10, 0), (0, 0), 0, (10, 0), -0.2),
    "the start: no stock to sell": ((10, 0), (9, 9), 0, (10, 9), -0.9 - 0.2 - 0.2),
    "a full step": ((20, 10), (5, 3), 4, (18, 11), 2.0 - 0.3 - 0.6 - 0.1),
    "six units need two trucks": ((20, 10), (6, 0), 0, (14, 16), -0.6 - 0.2),
    "five units need one truck": ((20, 10), (5, 0), 0, (15, 15), -0.6 - 0.1),
    "no more is shipped than the factory has": ((3, 0), (9, 0), 0, (0, 3), -0.06 - 0.1),
    "the warehouse's limit, room made by the sale counts": ((20, 49), (9, 0), 4, (15, 50), 2.0 - 1.38 - 0.1),
    "a full warehouse takes nothing": ((20, 50), (9, 0), 0, (20, 50), -1.4),
    "the factory's limit, room made by the shipment counts": ((49, 10), (3, 9), 0, (50, 13), -0.4 - 1.18 - 0.1),
    "a full factory produces nothing": ((50, 10), (0, 9), 0, (50, 10), -1.2),
}


@pytest.mark.parametrize(("stock", "action", "sold", "after", "reward"), STEPS.values(), ids=STEPS)
def test_a_step_by_hand(stock, action, sold, after, reward) -> None:
    next_state, got = settle(_state(*stock), 10 * action[0] + action[1], sold)
    assert next_state == _state(*after)
    assert got == pytest.approx(reward, abs=1e-12)


def test_only_what_lay_in_the_warehouse_before_the_shipment_is_sold_and_unmet_demand_is_lost() -> None:
    parameters, rng = np.array([40.0]), np.random.default_rng(0)
    for _ in range(100):  # demand is far above the stock of 2 every time
        next_state, reward, terminated = step(_state(30, 2), 90, parameters, rng)
        assert next_state == _state(21, 9)
        assert reward == pytest.approx(1.0 - 0.64 - 0.2, abs=1e-12)
        assert not terminated


def _outcomes(state: int, action: int, mean: float) -> tuple[dict[int, float], float]:
    """(next state to probability, expected reward), written down from the specification once more."""
    factory, warehouse = divmod(state, 51)
    wish, make = divmod(action, 10)
    ahead: dict[int, float] = {}
    expected, left = 0.0, 1.0
    for sold in range(warehouse + 1):
        p = left if sold == warehouse else math.exp(-mean) * mean**sold / math.factorial(sold)
        left -= p
        ship = min(wish, factory, 50 - warehouse + sold)
        produce = min(make, 50 - factory + ship)
        reward = 0.5 * sold - 0.1 * produce - 0.02 * (factory + warehouse) - 0.1 * math.ceil(ship / 5)
        after = (factory - ship + produce) * 51 + warehouse - sold + ship
        ahead[after] = ahead.get(after, 0.0) + p
        expected += p * reward
    return ahead, expected


@pytest.mark.parametrize("mean", [2.5, 5.0])
def test_the_model_is_the_specifications_row_by_row(mean: float) -> None:
    model, rng = model_of(parse_task(f"supply_chain:demand_mean={mean}").name), np.random.default_rng(1)
    pairs = [(int(rng.integers(2601)), int(rng.integers(100))) for _ in range(60)]
    for state, action in [*pairs, (0, 0), (2600, 99), (_state(50, 0), 99), (_state(0, 50), 99)]:
        ahead, expected = _outcomes(state, action, mean)
        row = np.zeros(2601)
        row[list(ahead)] = list(ahead.values())
        assert model.transitions[[state * 100 + action]].toarray()[0] == pytest.approx(row, abs=1e-12)
        assert model.rewards[state, action] == pytest.approx(expected, abs=1e-12)


def test_the_start_is_ten_units_at_the_factory() -> None:
    assert make_env(parse_task("supply_chain")).reset(seed=0)[0] == _state(10, 0)
