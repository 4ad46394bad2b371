"""Greedy evaluation: one point of the evaluation curve."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from trainables.curve import EvalPoint
from trainables.numerics.jit import compiled
from trainables.tasks.spec.tabular_model import TransitionModel

__all__ = ["EvalPoint", "expected_return"]

STEPS_AT_A_TIME = 4
"""Steps whose expected rewards are added up side by side, one addition of each waiting for none of the others."""


class Chain(NamedTuple):
    """The Markov chain of a policy over the R states that it reaches, as jagged diagonals.

    States are ranked by how many entries lead into them, most first. Diagonal k has the k-th entry into each state
    that has as many, side by side, so that a step of the chain is a few long loops without a branch.
    """

    order: NDArray[np.uint64]
    """(R,): the rank of each reached state, by the state's number."""
    pay: NDArray[np.float64]
    """(R,): the expected reward of each reached state, by the state's number."""
    diagonals: NDArray[np.int64]
    """Where each diagonal begins in `source` and `weight`, and where the last one ends."""
    source: NDArray[np.uint64]
    """The rank of the state that an entry leads from."""
    weight: NDArray[np.float64]
    """An entry's probability."""
    start: int
    """The rank of the start."""


@compiled
def _entries_into(
    indptr: NDArray[np.int32], indices: NDArray[np.int32], policy: NDArray[np.int64], actions: int, start: int
) -> NDArray[np.int64]:
    """How many entries lead into each state, (S,); -1 for states that are never reached."""
    into = np.full(len(policy), -1)
    waiting = np.zeros(len(policy), np.int64)
    into[start], waiting[0], left = 0, start, 1
    while left > 0:
        left -= 1
        row = waiting[left] * actions + policy[waiting[left]]
        for at in range(indptr[row], indptr[row + 1]):
            after = indices[at]
            if into[after] < 0:
                into[after], waiting[left] = 0, after
                left += 1
            into[after] += 1
    return into


@compiled
def _chain(
    indptr: NDArray[np.int32],
    indices: NDArray[np.int32],
    probabilities: NDArray[np.float64],
    rewards: NDArray[np.float64],
    policy: NDArray[np.int64],
    start: int,
) -> Chain:
    actions = rewards.shape[1]
    into = _entries_into(indptr, indices, policy, actions, start)
    reached = np.flatnonzero(into >= 0)
    most = int(np.max(into))
    begins = np.zeros(most + 2, np.int64)  # the first rank of the states with most, most - 1, ... entries
    for state in reached:
        begins[most - into[state] + 1] += 1
    begins = np.cumsum(begins)
    diagonals = np.zeros(most + 1, np.int64)
    for k in range(most):
        diagonals[k + 1] = diagonals[k] + begins[most - k]
    rank, pay = np.zeros(len(policy), np.int64), np.zeros(len(reached))
    for number, state in enumerate(reached):
        rank[state] = begins[most - into[state]]
        begins[most - into[state]] += 1
        pay[number] = rewards[state, policy[state]]
    source, weight = np.zeros(diagonals[most], np.uint64), np.zeros(diagonals[most])
    filled = np.zeros(len(policy), np.int64)
    for state in reached:  # in ascending order: so the entries into a state are added up
        row = state * actions + policy[state]
        for at in range(indptr[row], indptr[row + 1]):
            after = indices[at]
            slot = diagonals[filled[after]] + rank[after]
            source[slot], weight[slot] = rank[state], probabilities[at]
            filled[after] += 1
    return Chain(rank[reached].astype(np.uint64), pay, diagonals, source, weight, rank[start])


@compiled
def _step(chain: Chain, now: NDArray[np.float64], after: NDArray[np.float64]) -> None:
    """Put the distribution after one step, by rank, into `after`."""
    after[:] = 0.0
    for k in range(len(chain.diagonals) - 1):
        source = chain.source[chain.diagonals[k] : chain.diagonals[k + 1]]
        weight = chain.weight[chain.diagonals[k] : chain.diagonals[k + 1]]
        for to in range(len(source)):
            after[to] += now[source[to]] * weight[to]


@compiled
def _rewards(chain: Chain, masses: NDArray[np.float64], gained: NDArray[np.float64]) -> None:
    """Put the expected reward in each of STEPS_AT_A_TIME distributions into `gained`, added up by state number."""
    a = b = c = d = 0.0
    first, second, third, fourth = masses[0], masses[1], masses[2], masses[3]
    for number in range(len(chain.pay)):
        at, pay = chain.order[number], chain.pay[number]
        a += first[at] * pay
        b += second[at] * pay
        c += third[at] * pay
        d += fourth[at] * pay
    gained[0], gained[1], gained[2], gained[3] = a, b, c, d


@compiled
def _propagate(
    indptr: NDArray[np.int32],
    indices: NDArray[np.int32],
    probabilities: NDArray[np.float64],
    rewards: NDArray[np.float64],
    policy: NDArray[np.int64],
    start: int,
    time_limit: int,
    gamma: float,
) -> tuple[float, float]:
    chain = _chain(indptr, indices, probabilities, rewards, policy, start)
    masses, gained = np.zeros((STEPS_AT_A_TIME + 1, len(chain.pay))), np.zeros(STEPS_AT_A_TIME)
    masses[0, chain.start] = 1.0
    total, discounted, discount = 0.0, 0.0, 1.0
    for t in range(0, time_limit, STEPS_AT_A_TIME):
        for step in range(STEPS_AT_A_TIME):
            _step(chain, masses[step], masses[step + 1])
        _rewards(chain, masses, gained)
        for step in range(min(STEPS_AT_A_TIME, time_limit - t)):
            total += gained[step]
            discounted += discount * gained[step]
            discount *= gamma
        masses[0] = masses[STEPS_AT_A_TIME]
    return total, discounted


def expected_return(model: TransitionModel, policy: NDArray[np.int64], gamma: float) -> tuple[float, float]:
    """Return the exact (undiscounted, discounted) return of one episode of `policy` (S,), time limit included."""
    p = model.transitions
    return _propagate(p.indptr, p.indices, p.data, model.rewards, policy, model.start, model.time_limit, gamma)
