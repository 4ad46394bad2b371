"""Potential-based advice: a shaped reward, plain and scaled by delta."""

from __future__ import annotations

from typing import Any, ClassVar

from trainables.agents.agent import Agent
from trainables.agents.base import Rate
from trainables.agents.builtin.dqn import DQN, LEARNER
from trainables.agents.plots import ADVICE_FACTOR, DELTA_P90, KAPPA


class PotentialAdvice(DQN):
    """Potential-based advice: the reward is shaped by the potential A_src of state and action."""

    advice: ClassVar[Any] = "trainables.learners.advice:PotentialAdvice"


class DeltaPotentialAdvice(PotentialAdvice):
    """Potential-based advice with the potential exp(-max_a |delta(s,a)|) A_src(s,a), which follows delta."""

    advice: ClassVar[Any] = "trainables.learners.advice:DeltaPotentialAdvice"

    delta_learning_rate: Rate = 5e-4
    """alpha_d, the step size of the delta network (Table 7)."""


DPBA = Agent(
    "dpba",
    "potential-based advice: reward shaping by A_src",
    PotentialAdvice,
    "dqn",
    LEARNER,
    "deep",
    look="sky",
    plots=(KAPPA, ADVICE_FACTOR),
)

DELTA_DPBA = Agent(
    "delta_dpba",
    "potential-based advice scaled by delta",
    DeltaPotentialAdvice,
    "dqn",
    LEARNER,
    "deep",
    look="pink",
    plots=(KAPPA, ADVICE_FACTOR, DELTA_P90),
)
