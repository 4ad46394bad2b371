"""Ablations of Algorithm 2: factors of the same size that do not depend on the state."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, ClassVar

from trainables.agents.agent import Agent
from trainables.agents.builtin.dqn import DQN, LEARNER
from trainables.agents.builtin.explicit_shaping import DeltaShaping
from trainables.agents.plots import ADVICE_FACTOR, DELTA_P90, KAPPA


class ConstantShaping(DeltaShaping):
    """delta_es with one factor for all states, the mean of their factors; an ablation."""

    advice: ClassVar[Any] = "trainables.learners.baselines.ablations:ConstantFactor"
    unwritten: ClassVar[Mapping[str, Any]] = DQN.unwritten


class ShuffledShaping(DeltaShaping):
    """delta_es with the factor of another, random state; an ablation."""

    advice: ClassVar[Any] = "trainables.learners.baselines.ablations:ShuffledFactor"
    unwritten: ClassVar[Mapping[str, Any]] = DQN.unwritten


CONSTANT_ES = Agent(
    "constant_es",
    "ablation of delta_es: one factor of the same mean for all states",
    ConstantShaping,
    "dqn",
    LEARNER,
    "deep",
    shown=("advice_fraction",),
    look="ochre",
    plots=(KAPPA, ADVICE_FACTOR, DELTA_P90),
)

SHUFFLED_ES = Agent(
    "shuffled_es",
    "ablation of delta_es: each state has the factor of another",
    ShuffledShaping,
    "dqn",
    LEARNER,
    "deep",
    shown=("advice_fraction",),
    look="plum",
    plots=(KAPPA, ADVICE_FACTOR, DELTA_P90),
)
