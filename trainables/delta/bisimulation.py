"""An upper bound of the bisimulation distance between the states of two tabular tasks.

Bisimulation (Ferns, Panangaden and Precup, 2004): d(s,t) = max_a |r(s,a) - r(t,a)| + gamma W_d(p(.|s,a), p(.|t,a)),
where W_d is the Wasserstein distance under d itself. W needs a linear program for each of S x S x A entries in every
sweep (640,000 on a 20 x 20 grid). Here each entry keeps one coupling: it matches the outcomes of both tasks in order of
their probability, then of their number. Any coupling costs at least W, so the fixed point is an upper bound; on equal
tasks it is 0 on the diagonal, as d is.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from trainables.errors import InputError
from trainables.numerics.jit import compiled
from trainables.tasks.registry import model_of
from trainables.tasks.spec.tabular_model import TransitionModel

F64 = NDArray[np.float64]
I64 = NDArray[np.int64]

TOLERANCE = 1e-3
"""Largest change in the last sweep, as a share of the largest distance possible times 1 - gamma."""
MAX_PAIRS = 1_000_000
ROUNDS, SWEEPS = 100, 300


def _ordered(model: TransitionModel) -> tuple[I64, I64, F64]:
    """Return (row starts, outcomes, probabilities), each row sorted by probability; a terminal state stays."""
    p, actions = model.transitions, model.rewards.shape[1]
    starts, outcomes, probabilities = [0], [], []
    for row in range(p.shape[0]):
        part = slice(p.indptr[row], p.indptr[row + 1])
        order = np.lexsort((p.indices[part], -p.data[part]))
        empty = not len(order)
        outcomes.append(np.array([row // actions]) if empty else p.indices[part][order])
        probabilities.append(np.ones(1) if empty else p.data[part][order])
        starts.append(starts[-1] + len(outcomes[-1]))
    return np.array(starts), np.concatenate(outcomes).astype(np.int64), np.concatenate(probabilities)


@compiled
def _cost(i: int, j: int, a0: I64, a1: I64, a2: F64, b0: I64, b1: I64, b2: F64, d: F64) -> float:
    """Return the cost under d of the coupling of row i of one task with row j of the other."""
    m, n = a0[i], b0[j]
    left, right, total = float(a2[m]), float(b2[n]), 0.0
    while True:
        mass = min(left, right)
        total += mass * float(d[a1[m], b1[n]])
        left -= mass
        right -= mass
        if left <= 1e-12:
            m += 1
            if m == a0[i + 1]:
                return total
            left = float(a2[m])
        if right <= 1e-12:
            n += 1
            if n == b0[j + 1]:
                return total
            right = float(b2[n])


@compiled
def _solve(
    a0: I64, a1: I64, a2: F64, b0: I64, b1: I64, b2: F64, r: F64, u: F64, gamma: float, tolerance: float, d: F64
) -> None:
    """Fill d (S, T): alternate between the best action of every pair and cheap sweeps of it, until no pair changes."""
    states, actions = r.shape
    others = u.shape[0]
    best = np.zeros((states, others), np.int64)
    for _ in range(ROUNDS):
        change = 0.0
        for s in range(states):
            for t in range(others):
                largest = -1.0
                for a in range(actions):
                    cost = _cost(s * actions + a, t * actions + a, a0, a1, a2, b0, b1, b2, d)
                    value = abs(r[s, a] - u[t, a]) + gamma * cost
                    if value > largest:
                        largest = value
                        best[s, t] = a
                change = max(change, abs(largest - d[s, t]))
                d[s, t] = largest
        if change < tolerance:
            break
        for _ in range(SWEEPS):
            change = 0.0
            for s in range(states):
                for t in range(others):
                    a = best[s, t]
                    cost = _cost(s * actions + a, t * actions + a, a0, a1, a2, b0, b1, b2, d)
                    value = abs(r[s, a] - u[t, a]) + gamma * cost
                    change = max(change, abs(value - d[s, t]))
                    d[s, t] = value
            if change < tolerance:
                break


def distances(source: TransitionModel, target: TransitionModel, gamma: float) -> F64:
    """Return the bound (S, T) for every pair of states of two tasks with the same actions.

    Raises InputError where there are more than MAX_PAIRS pairs of states.
    """
    states, others = len(source.rewards), len(target.rewards)
    if states * others > MAX_PAIRS:
        raise InputError(f"bisimulation of {states} and {others} states has {states * others} pairs, over {MAX_PAIRS}")
    d = np.zeros((states, others))
    most = float(max(source.rewards.max(), target.rewards.max()) - min(source.rewards.min(), target.rewards.min()))
    _solve(*_ordered(source), *_ordered(target), source.rewards, target.rewards, gamma, TOLERANCE * max(most, 1e-9), d)
    return d


def start_distance(source: str, target: str, gamma: float) -> float:
    """Return the bound for the start states of two tasks."""
    src, trg = model_of(source), model_of(target)
    return float(distances(src, trg, gamma)[src.start, trg.start])
