"""Exact evaluation against plain sampling, and on a task small enough to do by hand."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.sparse import csr_array

from trainables.curve import EvalPoint
from trainables.delta.exact import exact_q
from trainables.evaluation import expected_return
from trainables.tasks.make import make_env
from trainables.tasks.registry import model_of, parse_task
from trainables.tasks.spec.tabular_model import TransitionModel


def test_two_states_by_hand() -> None:
    # state 0, action 0: reward 2, stays with probability .75, else ends in state 1; action 1 is never taken
    transitions = csr_array(np.array([[0.75, 0.25], [1.0, 0.0], [0.0, 0.0], [0.0, 0.0]]))
    transitions.eliminate_zeros()
    model = TransitionModel(transitions, np.array([[2.0, 9.0], [0.0, 0.0]]), start=0, time_limit=3)
    total, discounted = expected_return(model, np.zeros(2, np.int64), 0.5)
    assert total == pytest.approx(2 * (1 + 0.75 + 0.75**2), abs=1e-15)
    assert discounted == pytest.approx(2 * (1 + 0.375 + 0.375**2), abs=1e-15)


@pytest.mark.parametrize("task", ["windy_gridworld:wind=small", "supply_chain:demand_mean=5"])
def test_the_exact_return_is_the_mean_of_sampled_episodes(task: str) -> None:
    policy = exact_q(task.partition(":")[0], 0.99).argmax(axis=1)
    env, returns = make_env(parse_task(task)), []
    for episode in range(150):
        state, total, done = env.reset(seed=episode)[0], 0.0, False
        while not done:
            state, reward, terminated, truncated, _ = env.step(policy[state])
            total, done = total + float(reward), terminated or truncated
        returns.append(total)
    exact = expected_return(model_of(task), policy, 0.99)[0]
    assert abs(np.mean(returns) - exact) < 4.5 * np.std(returns) / np.sqrt(len(returns))


def test_points_are_equal_whatever_the_clock_said() -> None:
    point = EvalPoint(1, 2, 3.0, 4.0, None, {}, seconds=1.0)
    assert point == EvalPoint(1, 2, 3.0, 4.0, None, {}, seconds=2.0)
    assert point != EvalPoint(1, 2, 3.5, 4.0, None, {}, seconds=1.0)


def plain_return(model: TransitionModel, policy: NDArray[np.int64], gamma: float) -> tuple[float, float]:
    """The same sums in the same order, state by state."""
    p, (states, actions) = model.transitions, model.rewards.shape
    now, total, discounted = np.zeros(states), 0.0, 0.0
    now[model.start] = 1.0
    discount = 1.0
    for _ in range(model.time_limit):
        reward, after = 0.0, np.zeros(states)
        for state in np.flatnonzero(now):
            row = state * actions + policy[state]
            reward += now[state] * model.rewards[state, policy[state]]
            for at in range(p.indptr[row], p.indptr[row + 1]):
                after[p.indices[at]] += now[state] * p.data[at]
        total, discounted = total + reward, discounted + discount * reward
        discount *= gamma
        now = after
    return float(total), float(discounted)


@pytest.mark.parametrize("time_limit", [1, 4, 7, 30])
def test_the_exact_return_has_the_bits_of_the_plain_sum(time_limit: int) -> None:
    rng = np.random.default_rng(time_limit)
    for states in (1, 2, 9, 40):
        actions = 3
        dense = rng.random((states * actions, states)) * (rng.random((states * actions, states)) < 0.2)
        dense[rng.random(states * actions) < 0.2] = 0.0  # states that end an episode
        rows = csr_array(dense / np.maximum(dense.sum(axis=1, keepdims=True), 1e-9))
        model = TransitionModel(rows, rng.normal(size=(states, actions)), int(rng.integers(states)), time_limit)
        for _ in range(5):
            policy = rng.integers(0, actions, states)
            assert expected_return(model, policy, 0.9) == plain_return(model, policy, 0.9)
    grid = model_of("windy_gridworld")
    policy = rng.integers(0, 4, grid.rewards.shape[0])
    model = TransitionModel(grid.transitions, grid.rewards, grid.start, time_limit)
    assert expected_return(model, policy, 0.99) == plain_return(model, policy, 0.99)
