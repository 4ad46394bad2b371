"""The bound of the bisimulation distance against linear programs on tasks small enough for them."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import linprog
from scipy.sparse import csr_array

from trainables.delta.bisimulation import distances
from trainables.delta.exact import value_iteration
from trainables.errors import InputError
from trainables.tasks.spec.tabular_model import TransitionModel

GAMMA = 0.5


def _random(seed: int, states: int = 3, actions: int = 2) -> TransitionModel:
    rng = np.random.default_rng(seed)
    p = rng.dirichlet(np.full(states, 0.4), states * actions)
    p[-actions:] = 0.0  # the last state is terminal
    p[p < 0.02] = 0.0
    sums = p.sum(axis=1, keepdims=True)
    rewards = rng.normal(size=(states, actions))
    rewards[-1] = 0.0
    return TransitionModel(csr_array(np.divide(p, sums, where=sums > 0, out=np.zeros_like(p))), rewards, 0, 10)


def _wasserstein(p: np.ndarray, q: np.ndarray, d: np.ndarray) -> float:
    n = len(p)
    rows = [np.kron(np.eye(n)[i], np.ones(n)) for i in range(n)]
    columns = [np.kron(np.ones(n), np.eye(n)[i]) for i in range(n)]
    found = linprog(d.ravel(), A_eq=np.array(rows + columns)[:-1], b_eq=np.concatenate([p, q])[:-1])
    return float(found.fun)


def _exact(a: TransitionModel, b: TransitionModel) -> np.ndarray:
    states, actions = a.rewards.shape
    dense = [model.transitions.toarray() for model in (a, b)]
    for p in dense:
        for row in range(len(p)):
            if not p[row].any():
                p[row, row // actions] = 1.0
    d = np.zeros((states, states))
    for _ in range(12):
        d = np.array(
            [
                [
                    max(
                        abs(a.rewards[s, u] - b.rewards[t, u])
                        + GAMMA * _wasserstein(dense[0][s * actions + u], dense[1][t * actions + u], d)
                        for u in range(actions)
                    )
                    for t in range(states)
                ]
                for s in range(states)
            ]
        )
    return d


def test_the_bound_is_never_below_the_distance_by_linear_programs() -> None:
    a, b = _random(0), _random(1)
    bound, exact = distances(a, b, GAMMA), _exact(a, b)
    assert (bound >= exact - 0.01).all()
    assert bound.max() <= 2 * exact.max()


def test_a_task_is_at_distance_0_from_itself_state_by_state() -> None:
    d = distances(_random(2), _random(2), GAMMA)
    assert np.diag(d) == pytest.approx(0.0)
    assert (d + np.eye(3) > 0).all()


def test_it_bounds_the_difference_of_the_optimal_values() -> None:
    a, b = _random(3), _random(4)
    gap = np.abs(value_iteration(a, GAMMA).max(axis=1)[:, None] - value_iteration(b, GAMMA).max(axis=1)[None])
    assert (distances(a, b, GAMMA) >= gap - 0.01).all()


def test_too_many_states_are_refused() -> None:
    empty = TransitionModel(csr_array((1001, 1001)), np.zeros((1001, 1)), 0, 10)
    with pytest.raises(InputError, match=r"1002001 pairs, over 1000000"):
        distances(empty, empty, GAMMA)
