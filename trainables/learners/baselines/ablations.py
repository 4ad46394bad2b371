"""Ablations of Algorithm 2, which test whether its factor is informative about states or only scales the advice."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from trainables.learners.advice import DeltaShaping, Follows, Run, best_action
from trainables.learners.advice_statistics import largest_delta, take_note
from trainables.networks.network import Network
from trainables.numerics.matmul import F32
from trainables.numerics.rng import stream


class ConstantFactor(DeltaShaping):
    """One factor for all states: the mean of exp(-max_a |delta(s,a)|) over the replay buffer, updated each episode."""

    delta: Network

    def begin(self, run: Run) -> None:
        """Keep the access to states in the replay buffer."""
        self._remembered = run.remembered
        self._exponent = np.zeros(1, np.float32)
        """The exponent e of the factor exp(-e), in place of max_a |delta|."""

    def episode(self, number: int) -> None:
        """Update the factor while there is advice."""
        states = self._remembered() if self.kappa else self._no_states
        if len(states):
            sizes = largest_delta(self.delta, states).tolist()
            self._exponent[0] = -math.log(max(math.fsum(math.exp(-size) for size in sizes) / len(sizes), 1e-30))

    def follows(self) -> Follows:
        """Return the source, and one exponent for all states."""
        return Follows(self.source, None, self._exponent)

    def factor(self, observations: F32) -> F32:
        """Return the factor at each observation, (n,)."""
        return np.full(len(observations), math.exp(-float(self._exponent[0])), np.float32)

    def state(self) -> dict[str, Any]:
        """Return the state of Algorithm 2, and the exponent."""
        return super().state() | {"exponent": self._exponent.copy()}

    def restore(self, state: Mapping[str, Any]) -> None:
        """Restore what `state` returned."""
        super().restore(state)
        self._exponent[:] = state["exponent"]

    _no_states = np.zeros((0, 0), np.float32)


class ShuffledFactor(DeltaShaping):
    """The factor of another state: exp(-max_a |delta(s',a)|), with s' drawn from the replay buffer in every step."""

    delta: Network

    def begin(self, run: Run) -> None:
        """Keep the access to states in the replay buffer, and a random stream to draw from them."""
        self._remembered = run.remembered
        self._rng = stream(run.cell.seed, "advice", run.cell.task)
        self._states = run.remembered()

    def episode(self, number: int) -> None:
        """Fetch states from the replay buffer."""
        self._states = self._remembered()

    def best(self, q: F32, observation: F32) -> int:
        """Return the action of eq. (5) with delta of another state, or of this one while the buffer is empty."""
        other = self._states[self._rng.integers(len(self._states))] if len(self._states) else observation
        delta = self.delta.row(other)
        take_note(self.advised, delta, delta)
        return int(best_action(q, self.source.row(observation), delta, self.kappa))

    def state(self) -> dict[str, Any]:
        """Return the state of Algorithm 2, and the random stream."""
        return super().state() | {"rng": self._rng.bit_generator.state}

    def restore(self, state: Mapping[str, Any]) -> None:
        """Restore what `state` returned."""
        super().restore(state)
        self._rng.bit_generator.state = state["rng"]
