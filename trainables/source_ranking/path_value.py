"""The value of following a source on a tabular target, estimated from target episodes of any policy.

A transition is a sample of a source's delta if the source would have taken the same action. The discounted sum of delta
along the source's path is the return of following it minus its predicted return V_src(s_0):
D(s) = delta(s, pi(s)) + gamma E[D(s')]. It is solved here on the observed transitions, with delta = 0 where there are
none: the prior belief that source and target are equal.
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
"""Largest number of sweeps: gamma^2000 is 2e-9 at gamma = .99."""


class Seen(NamedTuple):
    """m distinct transitions. The state S is the end of an episode."""

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
    """V_src at the start, the return that the source predicts."""
    path_delta: float
    """The discounted return of following it minus the promise."""
    se: float
    """Standard error of path_delta: from the samples on the path, and from states without samples."""
    delta: float
    """Root mean square of delta(s, pi(s)) over the discounted path, without the noise of the samples."""
    unseen: float
    """Discounted probability of leaving the observed states. Beyond them delta is assumed 0; `se` grows by what a delta
    of the usual size in every later step would add."""

    @property
    def value(self) -> float:
        """The estimated discounted return of following the source."""
        return self.promise + self.path_delta


def nothing_seen() -> Seen:
    """Return an empty set of transitions."""
    nowhere, nothing = np.zeros(0, np.int64), np.zeros(0)
    return Seen(nowhere, nowhere, nowhere, nothing, nothing, nothing)


def merged(seen: Seen, other: Seen, states: int, actions: int) -> Seen:
    """Return two sets of transitions as one; each may have duplicates."""
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
    """Compute D (S + 1), delta (S,), summed squared deviations of the samples (2, S) and visits (S,) of a source.

    spread[0] is for samples of delta, spread[1] for those of delta + gamma D(s'). D is also the initial value.
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
    """Return the discounted visits (S,) of the source's path; it ends in states without observations."""
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
    """Estimates the value of following one source from the transitions of a target."""

    def __init__(self, q_src: F64, start: int, gamma: float) -> None:
        states = len(q_src)
        self.pi: I64 = q_src.argmax(axis=1)
        self._v = np.append(q_src.max(axis=1), 0.0)
        self._start, self._gamma = start, gamma
        self._d = np.zeros(states + 1)
        self._delta, self._visits, self._spread = np.zeros(states), np.zeros(states), np.zeros((2, states))

    def value(self, seen: Seen) -> float:
        """Return the estimated discounted return of following the source."""
        solve(seen, self.pi, self._v, self._gamma, self._d, self._delta, self._spread, self._visits)
        return float(self._v[self._start] + self._d[self._start])

    def estimate(self, seen: Seen) -> Following:
        """Return the estimate with its standard error (delta method), and the size of delta along the path."""
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
    """Return the variance of a sample in each state, with the pooled variance as one more sample, so that n = 1 works.

    Where no state was visited twice, noise and delta cannot be distinguished, and all of delta counts as noise.
    """
    freedom = float((n - 1).sum())
    pooled = float(spread.sum()) / freedom if freedom > 0 else float((delta**2).mean()) if len(delta) else 0.0
    result: F64 = (spread + pooled) / n
    return result
