"""A warm start: Q begins with the source's weights."""

from __future__ import annotations

from typing import Any, ClassVar, Literal

from trainables.agents.agent import Agent
from trainables.agents.base import Probability, Rate
from trainables.agents.builtin.dqn import DQN, LEARNER


class WarmStart(DQN):
    """DQN that begins with the source's weights (Sabatelli and Geurts, "On the Transferability of Deep-Q Networks",
    arXiv 2110.02639).

    Its exploration is short: under many random actions it would unlearn what the source knows.
    """

    advice: ClassVar[Any] = "trainables.learners.baselines.warm_start:WarmStart"

    last_layer: Literal["source", "fresh"] = "source"
    """Whether the last layer begins with the source's weights too, or with new random ones."""
    warm_epsilon: Probability = 0.3
    """epsilon at the start, in place of epsilon_start."""
    warm_decay_share: Rate = 0.1
    """The decay of epsilon as a share of epsilon_decay."""

    @property
    def epsilon_schedule(self) -> tuple[float, float]:
        """Return (epsilon at the start, its decay)."""
        return self.warm_epsilon, self.warm_decay_share * self.epsilon_decay


WARM_START = Agent(
    "warm_start",
    "DQN that begins with the source's weights",
    WarmStart,
    "dqn",
    LEARNER,
    "deep",
    look="orange",
)
