"""train(cell, source): when it evaluates, and what it refuses."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest

from tests.trainables.small_cells import GAMMA, REVERSED, digest_of, points_of, return_of, small_cell
from trainables.cell import Cell, Source
from trainables.delta.exact import exact_q
from trainables.errors import InputError, TrainingError
from trainables.knowledge import Knowledge
from trainables.learners import q_learning
from trainables.training.source_knowledge import exact_source
from trainables.training.train import train


@pytest.mark.parametrize(
    ("episodes", "every", "expected"),
    [
        (30, 10, [0, 10, 20, 30]),
        (25, 10, [0, 10, 20, 25]),
        (11, 10, [0, 10, 11]),
        (5, 10, [0, 5]),
        (1, 1, [0, 1]),
    ],
)
def test_it_evaluates_before_training_every_n_episodes_and_after_the_last_one(episodes, every, expected) -> None:
    points = points_of(small_cell("q_learning", episodes=episodes, evaluate_every=every))
    assert [point.episode for point in points] == expected
    assert [point.training_return is None for point in points] == [True] + [False] * (len(expected) - 1)
    steps = [point.step for point in points]
    assert steps[0] == 0
    assert steps == sorted(set(steps))
    assert steps[-1] <= 200 * episodes


def test_training_returns_are_means_since_the_last_point() -> None:
    # A step costs 1, so the returns of a block are the steps that it took.
    points = points_of(small_cell("q_learning", episodes=400, evaluate_every=150))
    for before, after in itertools.pairwise(points):
        episodes = after.episode - before.episode
        assert after.training_return == -(after.step - before.step) / episodes


def test_both_returns_are_those_of_the_greedy_policy() -> None:
    training = train(small_cell("q_learning", episodes=200, evaluate_every=50))
    for point in training:
        assert point.greedy_return == return_of(REVERSED, training.knowledge().arrays["q"])
        # -1 a step: the undiscounted return bounds the discounted one, and 100 is the sum of gamma^t
        assert max(point.greedy_return, -1 / (1 - GAMMA)) <= point.discounted_return < 0


def test_knowledge_is_a_copy() -> None:
    training = train(small_cell("q_learning"))
    next(training)
    before = training.knowledge()
    digest = before.digest
    list(training)
    assert before.digest == digest != training.knowledge().digest


def test_seconds_grow_and_do_not_count_in_the_digest() -> None:
    cell = small_cell("q_learning")
    first, second = points_of(cell), points_of(cell)
    seconds = [point.seconds for point in first]
    assert seconds == sorted(seconds)
    assert seconds[0] > 0
    assert seconds != [point.seconds for point in second]
    assert digest_of(first) == digest_of(second)


def test_an_exact_source_is_computed_where_it_is_not_given() -> None:
    cell = small_cell("q_warm_start")
    given = points_of(cell, exact_source("windy_gridworld", 0.99))
    assert digest_of(points_of(cell)) == digest_of(given)


def test_an_exact_source_is_solved_with_the_cells_own_gamma() -> None:
    q = train(small_cell("q_warm_start", gamma=0.5)).knowledge().arrays["q"]
    assert (q == exact_q("windy_gridworld", 0.5)).all()


def _with_learned_source() -> Cell:
    source = Source(task="windy_gridworld", kind="learned", cell_id="0123456789abcdef")
    return Cell.create("delta_gate", REVERSED, 0, {"episodes": 2}, source)


def test_a_missing_learned_source_is_refused_with_the_cell_that_is_wanted() -> None:
    with pytest.raises(InputError, match="needs the knowledge of its source cell 0123456789abcdef"):
        train(_with_learned_source())


@pytest.mark.parametrize(
    ("arrays", "message"),
    [
        ({"q": np.zeros((2601, 100))}, r"shape \(2601, 100\), but the target task needs \(400, 4\)"),
        ({"q": np.zeros((400, 4), np.float32)}, "not a Q table of 64-bit floats"),
        ({"weights": np.zeros((400, 4))}, "not a Q table"),
        ({"q": np.full((400, 4), np.nan)}, "holds a NaN or an infinity"),
        ({"q": np.full((400, 4), -np.inf)}, "holds a NaN or an infinity"),
    ],
)
def test_a_source_that_does_not_fit_is_refused(arrays, message: str) -> None:
    with pytest.raises(InputError, match=message):
        train(_with_learned_source(), Knowledge(arrays))


@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf])
@pytest.mark.parametrize("good_points", [0, 1])
def test_a_return_that_is_not_finite_ends_the_training(monkeypatch, value: float, good_points: int) -> None:
    returns = iter([(-1.0, -1.0)] * good_points + [(value, value)])
    monkeypatch.setattr(q_learning, "expected_return", lambda *arguments: next(returns))
    training = train(small_cell("q_learning", episodes=3000, evaluate_every=1000))
    with pytest.raises(TrainingError, match=f"greedy return is {value} after episode {1000 * good_points}"):
        list(training)


def test_it_is_over_after_its_last_point() -> None:
    training = train(small_cell("q_learning"))
    assert len(list(training)) == 4
    assert list(training) == []
