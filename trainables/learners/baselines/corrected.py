"""Advice from the source's values under the target's dynamics: Q_src + delta."""

from __future__ import annotations

import numpy as np

from trainables.learners.advice import DeltaShaping
from trainables.learners.advice_statistics import NO_DELTA, take_note
from trainables.networks.network import Network
from trainables.numerics.matmul import F32


class CorrectedAdvice(DeltaShaping):
    """Explicit shaping, eq. (3), with the advantage of Q_src + delta in place of A_src.

    Q_src + delta estimates E_trg[r + gamma V_src(s')]: one step of the target's dynamics, then the source's values.
    """

    delta: Network

    def best(self, q: F32, observation: F32) -> int:
        """Return argmax_a Q + kappa (Q_src + delta)(s,a): the maximum over actions cancels out."""
        delta = self.delta.row(observation)
        take_note(self.advised, delta, NO_DELTA)
        corrected = self.source.row(observation) + delta
        return int((q + np.float32(self.kappa) * corrected).argmax())

    def rows(self, observations: F32) -> F32:
        """Return the advice (n, actions) at observations (n, inputs)."""
        corrected = self.source.rows(observations) + self.delta.rows(observations)
        advice: F32 = np.float32(self.kappa) * (corrected - corrected.max(axis=1, keepdims=True))
        return advice

    def factor(self, observations: F32) -> F32:
        """Return 1 at each observation, (n,), since delta does not scale the advice."""
        return np.ones(len(observations), np.float32)

    def statistics(self, observations: F32) -> dict[str, float]:
        """Return the statistics of Algorithm 2, and the share of states where delta changes the source's action."""
        found = super().statistics(observations)
        if len(observations) and not self.delta_rests:
            values = self.source.rows(observations)
            changed = (values + self.delta.rows(observations)).argmax(axis=1) != values.argmax(axis=1)
            found["corrected_share"] = float(changed.mean())
        return found
