"""What following a source would collect on a tabular target, from target episodes that anyone has played.

delta of a source is known where its own action was taken, whoever took it. Along the source's path it sums up to what
following it collects beyond its promise V_src(s_0): D(s) = delta(s, pi(s)) + gamma E[D(s')], solved here on the
transitions seen, with delta = 0 where nothing was seen: the prior belief that source and target are equal.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from trainables.delta.sample import delta_sample
from trainables.numerics.jit import compiled

I64 = NDArray[np.int64]
F64 = NDArray[np.float64]

TOLERANCE = 1e-6
"""Largest change of D in the last sweep."""
SWEEPS = 2000
"""Most sweeps: gamma^2000 is 2e-9 at gamma = .99."""


class Seen(NamedTuple):
    """Transitions, equal ones once: m of them. The state S stands for the end of an episode."""

    state: I64
    action: I64
    next_state: I64
    times: F64
    """How often each was seen."""
    reward: F64
    """Sum of the rewards."""
    square: F64
    """Sum of the squared rewards."""


@dataclass(frozen=True)
class Following:
    """An estimate for one source."""

    promise: float
    """V_src at the start."""
    path_delta: float
    """What following it collects beyond that, discounted."""
    se: float
    """Standard error of path_delta: the spread of the samples on the path, and what may be where nothing was seen."""
    delta: float
    """Root mean square of delta(s, pi(s)) over the discounted path, the samples' own noise taken out."""
    unseen: float
    """Probability, discounted, of leaving what was seen; delta is taken for 0 from there on, with as much doubt as a
    sample of delta that size in every later step would justify."""

    @property
    def value(self) -> float:
        """The discounted return of following the source."""
        return self.promise + self.path_delta


def nothing_seen() -> Seen:
    """No transition at all."""
    nowhere, nothing = np.zeros(0, np.int64), np.zeros(0)
    return Seen(nowhere, nowhere, nowhere, nothing, nothing, nothing)


def merged(seen: Seen, other: Seen, states: int, actions: int) -> Seen:
    """Two sets of transitions as one; each may hold the same one more than once."""
    state, action, next_state = (np.concatenate([seen[i], other[i]]).astype(np.int64) for i in range(3))
    keys = (state * actions + action) * (states + 1) + next_state
    unique, first, inverse = np.unique(keys, return_index=True, return_inverse=True)
    times, reward, square = (
        np.bincount(inverse, np.concatenate(pair), len(unique)).astype(np.float64)
        for pair in ((seen.times, other.times), (seen.reward, other.reward), (seen.square, other.square))
    )
    return Seen(state[first], action[first], next_state[first], times, reward, square)


@compiled
def solve(seen: Seen, pi: I64, v_src: F64, gamma: float, d: F64, delta: F64, spread: F64, visits: F64) -> None:
    """Fill D (S + 1), delta (S,), the samples' summed squared deviations (2, S) and visits (S,) of one source.

    spread[0] is of delta's samples, spread[1] of those of delta + gamma D(s'). D comes in as a first guess.
    """
    states = len(pi)
    rows = np.nonzero(seen.action == pi[seen.state])[0]
    base = np.zeros(states)
    visits[:] = 0.0
    for i in rows:
        s = seen.state[i]
        visits[s] += seen.times[i]
        base[s] += seen.reward[i] + seen.times[i] * delta_sample(0.0, gamma, v_src[seen.next_state[i]], v_src[s])
    for s in range(states):
        delta[s] = base[s] / visits[s] if visits[s] > 0 else 0.0
        d[s] = d[s] if visits[s] > 0 else 0.0
    after = np.zeros(states)
    for _ in range(SWEEPS):
        after[:] = 0.0
        for i in rows:
            after[seen.state[i]] += seen.times[i] * d[seen.next_state[i]]
        change = 0.0
        for s in range(states):
            if visits[s] > 0:
                new = delta[s] + gamma * after[s] / visits[s]
                change = max(change, abs(new - d[s]))
                d[s] = new
        if change < TOLERANCE:
            break
    spread[:] = 0.0
    for i in rows:
        s, n = seen.state[i], seen.times[i]
        shift = delta_sample(0.0, gamma, v_src[seen.next_state[i]], v_src[s]) - delta[s]
        spread[0, s] += seen.square[i] + 2 * shift * seen.reward[i] + n * shift * shift
        shift += gamma * d[seen.next_state[i]] - (d[s] - delta[s])
        spread[1, s] += seen.square[i] + 2 * shift * seen.reward[i] + n * shift * shift


@compiled
def occupancy(seen: Seen, pi: I64, visits: F64, start: int, gamma: float) -> F64:
    """Discounted visits (S,) of the source's path in what was seen, unseen states included as ends of it."""
    states = len(pi)
    rows = np.nonzero(seen.action == pi[seen.state])[0]
    total, now, after = np.zeros(states), np.zeros(states + 1), np.zeros(states + 1)
    now[start] = 1.0
    for _ in range(SWEEPS):
        mass = 0.0
        for s in range(states):
            total[s] += now[s]
            mass += now[s] * (visits[s] > 0)
        if mass < TOLERANCE:
            break
        after[:] = 0.0
        for i in rows:
            s = seen.state[i]
            after[seen.next_state[i]] += gamma * now[s] * seen.times[i] / visits[s]
        now, after = after, now
    return total


class Follower:
    """One source, held against all transitions of a target as they come in."""

    def __init__(self, q_src: F64, start: int, gamma: float) -> None:
        states = len(q_src)
        self.pi: I64 = q_src.argmax(axis=1)
        self._v = np.append(q_src.max(axis=1), 0.0)
        self._start, self._gamma = start, gamma
        self._d = np.zeros(states + 1)
        self._delta, self._visits, self._spread = np.zeros(states), np.zeros(states), np.zeros((2, states))

    def value(self, seen: Seen) -> float:
        """The discounted return of following the source, as far as is known."""
        solve(seen, self.pi, self._v, self._gamma, self._d, self._delta, self._spread, self._visits)
        return float(self._v[self._start] + self._d[self._start])

    def estimate(self, seen: Seen) -> Following:
        """The same with its standard error (delta method), and delta's size along the path."""
        value = self.value(seen)
        weight = occupancy(seen, self.pi, self._visits, self._start, self._gamma)
        known = self._visits > 0
        n, mu = self._visits[known], weight[known]
        variance = _variance(self._spread[0][known], n, self._delta[known])
        noise, error = variance / n, _variance(self._spread[1][known], n, self._delta[known]) / n
        unseen = float(weight[~known].sum())
        usual = math.sqrt(float((mu @ (self._delta[known] ** 2 + variance)) / mu.sum())) if known.any() else math.inf
        doubt = usual * unseen / (1 - self._gamma) if unseen else 0.0
        square = float(mu @ (self._delta[known] ** 2 - noise)) / max(float(mu.sum()), TOLERANCE)
        return Following(
            promise=float(self._v[self._start]),
            path_delta=value - float(self._v[self._start]),
            se=math.hypot(math.sqrt(float(mu**2 @ error)), doubt),
            delta=math.sqrt(max(square, 0.0)),
            unseen=unseen,
        )


def _variance(spread: F64, n: F64, delta: F64) -> F64:
    """Variance of one sample in each state: its own, and the pooled one for one more sample, so that n = 1 has one.

    Where no state was seen twice, nothing tells noise from delta: all of delta counts as noise.
    """
    freedom = float((n - 1).sum())
    pooled = float(spread.sum()) / freedom if freedom > 0 else float((delta**2).mean()) if len(delta) else 0.0
    result: F64 = (spread + pooled) / n
    return result
