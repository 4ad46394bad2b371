"""Kickstarting: distillation of the source's policy in addition to Q-learning."""

from __future__ import annotations

from typing import Any, ClassVar

from trainables.agents.agent import Agent
from trainables.agents.base import NonNegative, Positive
from trainables.agents.builtin.baselines.jump_start import Annealed
from trainables.agents.builtin.dqn import LEARNER
from trainables.agents.plots import KAPPA


class Kickstart(Annealed):
    """DQN with a second loss, the distance of its policy from the source's, which fades (Schmitt et al., "Kickstarting
    Deep Reinforcement Learning", arXiv 1803.03835; the policy of a Q-network as its softmax: Rusu et al., "Policy
    Distillation", arXiv 1511.06295).
    """

    advice: ClassVar[Any] = "trainables.learners.baselines.kickstart:Kickstart"

    weight: NonNegative = 1.0
    """Weight of the distance relative to the TD loss; it fades with kappa."""
    temperature: Positive = 1.0
    """Temperature of both softmaxes, in units of the return."""


KICKSTART = Agent(
    "kickstart",
    "DQN with a distillation loss towards the source's policy, which fades",
    Kickstart,
    "dqn",
    LEARNER,
    "deep",
    shown=("advice_fraction", "weight"),
    look="wine",
    plots=(KAPPA,),
)
