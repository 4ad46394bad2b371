"""threshold: auto is the noise floor of the source."""

from __future__ import annotations

import numpy as np
import pytest

from trainables.cell import Cell, Source
from trainables.delta.exact import exact_q
from trainables.delta.noise_floor import noise_floor
from trainables.delta.tabular_estimator import DeltaRule
from trainables.knowledge import Knowledge
from trainables.training.train import train

SOURCE, REVERSED = "windy_gridworld", "windy_gridworld:wind=reversed"
RULE = DeltaRule(False, 0.05, np.inf, 0.0, 0, 0.0)
CONFIDENT = DeltaRule(True, 0.05, np.inf, 3.0, 5, 0.3)
EXACT = Source(task=SOURCE, kind="exact")


def test_an_exact_source_has_a_small_floor_and_a_learned_one_about_the_papers_10() -> None:
    training = train(Cell.create("q_learning", SOURCE, 0))
    list(training)
    learned = training.knowledge().arrays["q"]
    exact = noise_floor(SOURCE, exact_q(SOURCE, 0.99), RULE, 0.99, 500, 0)
    assert 0.5 < exact < 3
    assert 4 < noise_floor(SOURCE, learned, RULE, 0.99, 500, 0) < 20
    assert noise_floor(SOURCE, exact_q(SOURCE, 0.99), CONFIDENT, 0.99, 500, 0) < 4


def test_the_floor_is_the_same_for_the_same_seed_and_grows_with_the_episodes() -> None:
    q = exact_q(SOURCE, 0.99)
    floors = [noise_floor(SOURCE, q, RULE, 0.99, episodes, 3) for episodes in (50, 50, 500)]
    assert floors[0] == floors[1] < floors[2]


def test_a_source_that_errs_by_a_constant_has_a_floor_of_about_that_times_1_minus_gamma() -> None:
    q = exact_q(SOURCE, 0.99) + 500.0  # every delta is -(1 - gamma) 500 but at the goal, where it is -500
    assert noise_floor(SOURCE, q, RULE, 0.99, 50, 0) > 5


@pytest.mark.parametrize("agent", ["delta_gate", "confidence_gate"])
def test_auto_closes_the_gate_on_another_task_and_says_what_it_came_to(agent: str) -> None:
    cell = Cell.create(agent, REVERSED, 0, {"threshold": "auto", "episodes": 300}, EXACT)
    last = list(train(cell))[-1]
    assert last.statistics["gate_open"] == 0.0
    assert 0 < last.statistics["threshold"] < 5


def test_auto_is_another_cell_than_a_number_and_a_number_says_no_threshold() -> None:
    cells = [
        Cell.create("delta_gate", REVERSED, 0, {"threshold": value, "episodes": 10}, EXACT) for value in ("auto", 10.0)
    ]
    assert cells[0].id != cells[1].id
    assert "threshold" not in list(train(cells[1]))[-1].statistics
    assert Cell.from_json(cells[0].to_json()) == cells[0]


def test_the_floor_is_that_of_the_knowledge_given() -> None:
    cell = Cell.create("delta_gate", REVERSED, 0, {"threshold": "auto", "episodes": 10}, EXACT)
    plain, wrong = (
        list(train(cell, Knowledge({"q": exact_q(SOURCE, 0.99) * factor})))[-1].statistics["threshold"]
        for factor in (1.0, 1.5)
    )
    assert wrong > plain
