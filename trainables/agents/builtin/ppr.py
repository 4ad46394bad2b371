"""Probabilistic policy reuse (Appendix C)."""

from __future__ import annotations

from trainables.agents.agent import Agent
from trainables.agents.base import Probability
from trainables.agents.builtin.q_learning import LEARNER, Transfer
from trainables.agents.plots import MAX_DELTA, SOURCE_ACTION


class ProbabilisticPolicyReuse(Transfer):
    """PPR: each step takes the source's action with probability psi."""

    reuse = "psi"

    psi_start: Probability = 1.0
    """psi in the first episode."""
    nu: Probability = 0.99
    """psi is multiplied by nu after each episode (Appendix C)."""


PPR = Agent(
    "ppr",
    "probabilistic policy reuse",
    ProbabilisticPolicyReuse,
    "q_learning",
    LEARNER,
    shown=("nu",),
    usual=True,
    look="blue",
    plots=(SOURCE_ACTION, MAX_DELTA),
)
