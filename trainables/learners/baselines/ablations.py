"""Algorithm 2 without what its factor says of a state, to see whether it does more than scale the advice."""

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
    """One factor for every state: the mean of exp(-max_a |delta(s,a)|) over remembered states, anew each episode."""

    delta: Network

    def begin(self, run: Run) -> None:
        """Take note of where remembered states come from."""
        self._remembered = run.remembered
        self._exponent = np.zeros(1, np.float32)
        """What stands for delta: exp(-it) is the factor."""

    def episode(self, number: int) -> None:
        """Compute the factor anew, while there is advice."""
        states = self._remembered() if self.kappa else self._no_states
        if len(states):
            sizes = largest_delta(self.delta, states).tolist()
            self._exponent[0] = -math.log(max(math.fsum(math.exp(-size) for size in sizes) / len(sizes), 1e-30))

    def follows(self) -> Follows:
        """Return the source, and one exponent for every state."""
        return Follows(self.source, None, self._exponent)

    def factor(self, observations: F32) -> F32:
        """Return the factor at each observation, (n,)."""
        return np.full(len(observations), math.exp(-float(self._exponent[0])), np.float32)

    def state(self) -> dict[str, Any]:
        """Return what Algorithm 2 does, and the exponent."""
        return super().state() | {"exponent": self._exponent.copy()}

    def restore(self, state: Mapping[str, Any]) -> None:
        """Go back to what `state` returned."""
        super().restore(state)
        self._exponent[:] = state["exponent"]

    _no_states = np.zeros((0, 0), np.float32)


class ShuffledFactor(DeltaShaping):
    """The factor of another state: exp(-max_a |delta(s',a)|), s' drawn anew in every step from remembered states."""

    delta: Network

    def begin(self, run: Run) -> None:
        """Take note of where remembered states come from, with a random stream to draw from them."""
        self._remembered = run.remembered
        self._rng = stream(run.cell.seed, "advice", run.cell.task)
        self._states = run.remembered()

    def episode(self, number: int) -> None:
        """Take the states that are remembered now."""
        self._states = self._remembered()

    def best(self, q: F32, observation: F32) -> int:
        """Return the action of eq. (5) with delta of another state; of its own before any is remembered."""
        other = self._states[self._rng.integers(len(self._states))] if len(self._states) else observation
        delta = self.delta.row(other)
        take_note(self.advised, delta, delta)
        return int(best_action(q, self.source.row(observation), delta, self.kappa))

    def state(self) -> dict[str, Any]:
        """Return what Algorithm 2 does, and the random stream."""
        return super().state() | {"rng": self._rng.bit_generator.state}

    def restore(self, state: Mapping[str, Any]) -> None:
        """Go back to what `state` returned."""
        super().restore(state)
        self._rng.bit_generator.state = state["rng"]
