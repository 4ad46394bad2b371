"""Probabilistic policy reuse with networks."""

from __future__ import annotations

from typing import Any, ClassVar

from trainables.agents.agent import Agent
from trainables.agents.base import Probability
from trainables.agents.builtin.dqn import DQN, LEARNER
from trainables.agents.plots import PSI


class DeepPolicyReuse(DQN):
    """PPR for networks: each step takes the source's action with probability psi (Fernandez and Veloso,
    "Probabilistic Policy Reuse in a Reinforcement Learning Agent", AAMAS 2006), with psi and nu of the paper's
    Appendix C like the tabular `ppr`.
    """

    advice: ClassVar[Any] = "trainables.learners.baselines.policy_reuse:PolicyReuse"

    psi_start: Probability = 1.0
    """psi in the first episode."""
    nu: Probability = 0.99
    """psi is multiplied by nu after each episode (Appendix C)."""


PPR_DQN = Agent(
    "ppr_dqn",
    "probabilistic policy reuse with networks",
    DeepPolicyReuse,
    "dqn",
    LEARNER,
    "deep",
    shown=("nu",),
    look="teal",
    plots=(PSI,),
)
