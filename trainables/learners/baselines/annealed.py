"""Uses of a source that do not add to Q, and fade with kappa, eq. (6)."""

from __future__ import annotations

from trainables.learners.advice import ExplicitShaping, Follows
from trainables.numerics.matmul import F32


class Annealed(ExplicitShaping):
    """Acts on Q and is evaluated by Q; its use of the source is weighted by kappa, which decreases as in es."""

    def follows(self) -> Follows:
        """Return nothing: no action is chosen by the source's values."""
        return Follows()

    def best(self, q: F32, observation: F32) -> int:
        """Return argmax Q."""
        return int(q.argmax())

    def evaluated(self, values: F32, observations: F32) -> F32:
        """Return Q."""
        return values

    def statistics(self, observations: F32) -> dict[str, float]:
        """Return kappa."""
        return {"kappa": self.kappa}
