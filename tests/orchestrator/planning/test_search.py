"""Searching ranges: random draws and Optuna's suggestions are the same every time, and in the ranges."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import pytest

from orchestrator.planning.arms import Arm
from orchestrator.planning.search import Tuned, draw
from search_spaces.domains import Range
from search_spaces.search_space import Search
from trainables.cell import Cell, Source

RANGES = {
    "learning_rate": Range(low=0.001, high=0.5, log=True),
    "gamma": Range(low=0.5, high=0.99),
    "episodes": Range(low=10, high=20, integer=True),
    "evaluate_every": Range(low=1, high=50, integer=True, log=True),
}
ARM = Arm("q_learning", "windy_gridworld", (0, 1), ranges=RANGES)
KNOWN_DRAWS = [
    {"learning_rate": 0.0241793409429, "gamma": 0.534751184946, "episodes": 17, "evaluate_every": 1},
    {"learning_rate": 0.00759746984836, "gamma": 0.631744392509, "episodes": 10, "evaluate_every": 5},
]
KNOWN_SUGGESTIONS = [
    {"learning_rate": 0.025539351411, "gamma": 0.712814909334, "episodes": 18, "evaluate_every": 23},
    {"learning_rate": 0.154563323147, "gamma": 0.797020003795, "episodes": 16, "evaluate_every": 5},
]
"""As Tune's own domains and its searcher for Optuna drew them, before either was asked without Ray."""


def inside(values: dict[str, Any]) -> bool:
    return all(RANGES[name].low <= values[name] <= RANGES[name].high for name in RANGES)


def score(cells: Sequence[Cell]) -> float | None:
    """The larger gamma, the better."""
    return float(cells[0].hyperparameters["gamma"])


def suggestions(tuned: Tuned) -> list[dict[str, Any]]:
    """What a search asks for until its budget is spent, each told at once."""
    found = []
    while tuned.left:
        token, cells = tuned.suggest()
        assert [cell.seed for cell in cells] == list(ARM.seeds)
        tuned.tell(token, score(cells))
        tuned.tell(token, None)
        found.append({name: cells[0].hyperparameters[name] for name in RANGES})
    return found


def test_random_draws_are_those_of_the_first_results() -> None:
    draws = draw(ARM, Search(method="random", budget=50))
    assert draws[:2] == KNOWN_DRAWS
    assert all(map(inside, draws))
    assert draw(ARM, Search(method="random", budget=50)) == draws
    assert draw(ARM, Search(method="random", budget=2, seed=1)) != KNOWN_DRAWS


def test_two_sources_draw_the_same_configurations() -> None:
    one = Arm("q_learning", "windy_gridworld", (0, 1), ranges=RANGES, baseline_for="windy_gridworld:wind=small")
    assert draw(one, Search(method="random", budget=3)) == draw(ARM, Search(method="random", budget=3))


def test_optuna_asks_within_the_ranges_until_the_budget_is_spent_and_goes_on_from_there() -> None:
    search = Search(method="optuna", budget=12)
    asked = suggestions(Tuned(ARM, search, [], score))
    assert asked[:2] == KNOWN_SUGGESTIONS
    assert len(asked) == 12
    assert all(map(inside, asked))
    assert suggestions(Tuned(ARM, search, [], score)) == asked
    cells = [cell for values in asked for cell in ARM.cells(values)]
    assert Tuned(ARM, search, cells, score).left == 0
    more = suggestions(Tuned(ARM, Search(method="optuna", budget=15), cells, score))
    assert len(more) == 3
    assert not [values for values in more if values in asked]


def test_a_grid_beside_ranges_is_a_choice() -> None:
    sources = {0: ((Source(task="windy_gridworld", kind="exact"),),)}
    grid = ({"threshold": 1.0}, {"threshold": 2.0})
    arm = Arm("delta_gate", "windy_gridworld", (0,), grid, {"gamma": RANGES["gamma"]}, sources)
    tuned = Tuned(arm, Search(method="optuna", budget=8), [], score)
    assert {tuned.suggest()[1][0].hyperparameters["threshold"] for _ in range(8)} == {1.0, 2.0}
    assert {values["threshold"] for values in draw(arm, Search(method="random", budget=4))} == {1.0, 2.0}


def test_a_search_that_is_resumed_with_another_setting_starts_anew() -> None:
    # of 50 episodes or of 5,000: neither spends the other's budget, or tells its search anything
    trial = Arm("q_learning", "windy_gridworld", (0,), ({"episodes": 50},), {"gamma": RANGES["gamma"]})
    whole = Arm("q_learning", "windy_gridworld", (0,), ({"episodes": 5000},), {"gamma": RANGES["gamma"]})
    cell = trial.cells({"episodes": 50, "gamma": 0.75})[0]
    assert trial.owns(cell)
    assert not whole.owns(cell)
    narrower = Arm("q_learning", "windy_gridworld", (0,), ({"episodes": 50},), {"gamma": Range(low=0.8, high=0.9)})
    assert not narrower.owns(cell)


@pytest.mark.parametrize("option", RANGES.values())
def test_the_ends_of_a_range_are_in_it(option: Range) -> None:
    name = next(name for name in RANGES if RANGES[name] is option)
    arm = Arm("q_learning", "windy_gridworld", (0,), ranges={name: option})
    for end in option.ends():
        assert arm.owns(arm.cells({name: end})[0])


def test_a_word_is_in_no_range() -> None:
    sources = {0: ((Source(task="windy_gridworld:wind=small", kind="exact"),),)}
    arm = Arm("delta_gate", "windy_gridworld", (0,), ranges={"threshold": Range(low=1, high=20)}, sources=sources)
    assert [arm.owns(arm.cells({"threshold": value})[0]) for value in ("auto", 0.5, 10.0)] == [False, False, True]
