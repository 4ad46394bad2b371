"""Jump-start reinforcement learning."""

from __future__ import annotations

from typing import Any, ClassVar

from trainables.agents.agent import Agent
from trainables.agents.base import Rate
from trainables.agents.builtin.dqn import DQN, LEARNER
from trainables.agents.plots import GUIDE_STEPS, KAPPA


class Annealed(DQN):
    """What the agents have whose use of the source fades as the advice of es does."""

    advice_fraction: Rate = 0.25
    """C = 1 / (advice_fraction T): the share of T, the source run's steps, until kappa is 0 (eq. 6)."""


class JumpStart(Annealed):
    """The source acts in the first h steps of an episode (Uchendu et al., "Jump-Start Reinforcement Learning", arXiv
    2204.02372).

    h = kappa H, with H the mean length of the source's own episodes on the target task. The paper's curriculum lowers h
    by the agent's returns; here it falls at the pace of es's advice, so that both end after the same step.
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
