"""A warm start that is given up where it is worse than learning from scratch."""

from __future__ import annotations

from typing import Annotated, Any, ClassVar, Literal

from pydantic import Field

from trainables.agents.agent import Agent
from trainables.agents.base import Positive, Probability, Rate
from trainables.agents.builtin.dqn import DQN, LEARNER
from trainables.agents.plots import GIVEN_UP, PROBE_DIFFERENCE, TRANSFER_LEADS


class SafeStart(DQN):
    """DQN beside a network that begins with the source's weights, on one replay buffer; beyond the paper.

    Probes, training episodes like any other, compare the two by a confidence interval: the transferred network acts and
    is evaluated once it is better, and is given up for good once it is worse. The return of the source's policy is what
    it promises plus delta along its own path (Theorem 3's identity): the first probes are a test of that sum.
    """

    advice: ClassVar[Any] = "trainables.learners.baselines.safe_start:SafeStart"

    begins: Literal["source", "fresh"] = "source"
    """The second network's weights at the start; fresh: random weights, an ablation without transfer."""
    cycle: Annotated[int, Field(ge=4, le=1000)] = 4
    """Episodes of which one is a probe of each network."""
    recent: Annotated[int, Field(ge=5, le=1000)] = 20
    """Probes of each network that are compared, the last ones."""
    z: Positive = 3.0
    """Standard errors by which one network must be ahead."""
    warm_epsilon: Probability = 0.3
    """epsilon of the transferred network at the start, as warm_start's."""
    warm_decay_share: Rate = 0.1
    """The decay of its epsilon as a share of epsilon_decay."""


SAFE_START = Agent(
    "safe_start",
    "DQN beside a warm start, which is given up where it is worse",
    SafeStart,
    "dqn",
    LEARNER,
    "deep",
    shown=("begins",),
    look="emerald",
    plots=(TRANSFER_LEADS, GIVEN_UP, PROBE_DIFFERENCE),
)
