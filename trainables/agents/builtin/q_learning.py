"""Q-learning, direct reuse and warm start."""

from __future__ import annotations

from typing import ClassVar, Literal

from trainables.agents.agent import Agent
from trainables.agents.base import Hyperparameters, NonNegative, Probability, Rate
from trainables.agents.plots import MAX_DELTA


class QLearning(Hyperparameters):
    """Q-learning, eq. (1)."""

    reuse: ClassVar[Literal["never", "always", "psi", "gate"]] = "never"
    """When a step takes the source policy's action: never, always, with probability psi, or while the gate is open."""
    warm_start: ClassVar[bool] = False
    """Whether Q_trg begins as Q_src."""

    learning_rate: Rate = 0.5
    """alpha (Table 4)."""
    epsilon_start: Probability = 0.1
    """epsilon in the first episode (Table 4)."""
    epsilon_decay: NonNegative = 5e-4
    """epsilon_e = max(epsilon_start - epsilon_decay * e, 0), constant within episode e (Table 4)."""
    truncation: Literal["bootstrap", "terminal"] = "bootstrap"
    """Whether the step that reaches the time limit bootstraps, or counts as terminal."""


class Transfer(QLearning):
    """Q-learning with a source; it estimates delta whether it uses it or not."""

    delta_learning_rate: Rate = 0.05
    """alpha_d of eq. (2) (Table 5)."""


class PolicyReuse(Transfer):
    """Direct reuse: the source's policy in every step."""

    reuse = "always"


class WarmStart(Transfer):
    """Q-learning that starts from Q_src; beyond the paper."""

    warm_start = True


LEARNER = "trainables.learners.q_learning:TabularLearner"
"""The learner that all tabular agents with at most one source share: the loop of Algorithm 1."""

Q_LEARNING = Agent("q_learning", "Q-learning without transfer", QLearning, None, LEARNER, usual=True, look="grey")

POLICY_REUSE = Agent(
    "policy_reuse",
    "the source policy, unchanged (direct reuse)",
    PolicyReuse,
    "q_learning",
    LEARNER,
    usual=True,
    look="orange",
    plots=(MAX_DELTA,),
)

Q_WARM_START = Agent(
    "q_warm_start",
    "Q-learning that starts from Q_src",
    WarmStart,
    "q_learning",
    LEARNER,
    look="pink",
    plots=(MAX_DELTA,),
)
