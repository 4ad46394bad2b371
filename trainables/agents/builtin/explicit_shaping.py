"""Explicit shaping: acting on Q and the source's advice, plain and scaled by delta (Algorithm 2)."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import Any, ClassVar, Literal

from trainables.agents.agent import Agent
from trainables.agents.base import Rate
from trainables.agents.builtin.dqn import DQN, LEARNER
from trainables.agents.plots import ADVICE_FACTOR, DELTA_P90, KAPPA


class ExplicitShaping(DQN):
    """Explicit shaping: acts on Q(s,a) - kappa_t Phi(s,a), eq. (3), with Phi = -A_src."""

    advice: ClassVar[Any] = "trainables.learners.advice:ExplicitShaping"

    advice_fraction: Rate = 0.25
    """C = 1 / (advice_fraction T): the share of T, the source run's steps, until kappa is 0 (eq. 6)."""
    evaluation_policy: Literal["q", "shaped"] = "q"
    """The values that greedy evaluation maximises: Q alone, or those on which the agent acts."""


class DeltaShaping(ExplicitShaping):
    """Algorithm 2: explicit shaping with the factor exp(-max_a |delta(s,a)|), eq. (5)."""

    advice: ClassVar[Any] = "trainables.learners.advice:DeltaShaping"

    unwritten: ClassVar[Mapping[str, Any]] = MappingProxyType({**DQN.unwritten, "delta_after_advice": "train"})

    delta_learning_rate: Rate = 5e-4
    """alpha_d, the step size of the delta network (Table 7)."""
    delta_after_advice: Literal["rest", "train"] = "rest"
    """Whether the delta network is still trained once kappa is 0, when it can change no action any more."""


ES = Agent(
    "es",
    "explicit shaping: acts on Q + kappa A_src",
    ExplicitShaping,
    "dqn",
    LEARNER,
    "deep",
    shown=("advice_fraction",),
    usual=True,
    look="blue",
    plots=(KAPPA, ADVICE_FACTOR),
)

DELTA_ES = Agent(
    "delta_es",
    "Algorithm 2: explicit shaping scaled by delta",
    DeltaShaping,
    "dqn",
    LEARNER,
    "deep",
    rivals=("es", "constant_es", "shuffled_es"),
    shown=("advice_fraction",),
    usual=True,
    algorithm=2,
    look="vermilion",
    plots=(KAPPA, ADVICE_FACTOR, DELTA_P90),
)
