"""Advice from a source task: what the agents with a source add to Q, and when they stop (eqs. 3, 5 and 6)."""

from __future__ import annotations

import math

import numpy as np

from trainables.networks.network import Network
from trainables.numerics.jit import compiled
from trainables.numerics.matmul import F32


@compiled
def best_action(q: F32, q_src: F32, delta: F32, kappa: float) -> int:
    """argmax_a q + kappa exp(-max_b |delta|) A_src, the lowest index on ties; V_src cancels out of an argmax."""
    largest = np.float32(0.0)
    for a in range(len(delta)):
        largest = max(largest, abs(delta[a]))
    scale = kappa * math.exp(-largest)
    best, at = q[0] + scale * q_src[0], 0
    for a in range(1, len(q)):
        value = q[a] + scale * q_src[a]
        if value > best:
            best, at = value, a
    return at


_NO_DELTA = np.zeros(0, np.float32)


class Advice:
    """The advice kappa_t exp(-max_a |delta(s,a)|) A_src(s,a) of eq. (5), which is -kappa_t exp(...) Phi(s,a).

    Without a delta network its factor is 1 (eq. 3); with `decay` 0, kappa stays 1.
    """

    def __init__(self, source: Network, delta: Network | None, decay: float) -> None:
        self._source, self._delta, self._decay = source, delta, decay
        self.kappa = 1.0

    def decay(self) -> None:
        """kappa_t = max(0, kappa_{t-1} - C): eq. (6)."""
        self.kappa = max(0.0, self.kappa - self._decay)

    def best(self, q: F32, observation: F32) -> int:
        """The action of eq. (5) where the agent's own values are q (actions,)."""
        delta = _NO_DELTA if self._delta is None else self._delta.row(observation)
        return int(best_action(q, self._source.row(observation), delta, self.kappa))

    def rows(self, observations: F32) -> F32:
        """The advice (n, actions) at the observations (n, inputs)."""
        q_src = self._source.rows(observations)
        advantage = q_src - q_src.max(axis=1, keepdims=True)
        result: F32 = advantage * (self.kappa * self.factor(observations)[:, None]).astype(np.float32)
        return result

    def factor(self, observations: F32) -> F32:
        """exp(-max_a |delta(s,a)|) at each observation, (n,); 1 without delta."""
        if self._delta is None:
            return np.ones(len(observations), np.float32)
        result: F32 = np.exp(-self.largest_delta(observations))
        return result

    def largest_delta(self, observations: F32) -> F32:
        """max_a |delta(s,a)| at each observation, (n,); 0 without delta."""
        if self._delta is None:
            return np.zeros(len(observations), np.float32)
        result: F32 = np.abs(self._delta.rows(observations)).max(axis=1)
        return result
