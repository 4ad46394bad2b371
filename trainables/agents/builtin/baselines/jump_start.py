"""Jump-start reinforcement learning."""

from __future__ import annotations

from typing import Any, ClassVar

from trainables.agents.agent import Agent
from trainables.agents.base import Rate
from trainables.agents.builtin.dqn import DQN, LEARNER
from trainables.agents.plots import GUIDE_STEPS, KAPPA


class Annealed(DQN):
    """Hyperparameters of agents whose use of the source fades like the advice of es."""

    advice_fraction: Rate = 0.25
    """C = 1 / (advice_fraction T): the share of T, the source run's steps, until kappa is 0 (eq. 6)."""


class JumpStart(Annealed):
    """The source acts in the first h steps of an episode (Uchendu et al., "Jump-Start Reinforcement Learning", arXiv
    2204.02372).

    h = kappa H, where H is the mean length of the source's episodes on the target task. The cited curriculum lowers h
    by the agent's returns; here h falls with the advice of es, so that both end after the same step.
    """

    advice: ClassVar[Any] = "trainables.learners.baselines.jump_start:JumpStart"


JSRL = Agent(
    "jsrl",
    "jump-start: the source acts in the first steps of an episode, fewer and fewer",
    JumpStart,
    "dqn",
    LEARNER,
    "deep",
    shown=("advice_fraction",),
    look="brown",
    plots=(KAPPA, GUIDE_STEPS),
)
