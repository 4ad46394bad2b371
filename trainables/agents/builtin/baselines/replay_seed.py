"""Half of each minibatch from the source's transitions."""

from __future__ import annotations

from typing import Any, ClassVar

from trainables.agents.agent import Agent
from trainables.agents.base import Count, Probability
from trainables.agents.builtin.baselines.jump_start import Annealed
from trainables.agents.builtin.dqn import LEARNER
from trainables.agents.plots import KAPPA


class ReplaySeed(Annealed):
    """DQN with half of each minibatch from prior data (Ball et al., "Efficient Online Reinforcement Learning with
    Offline Data", arXiv 2302.02948): uncorrected transitions of the source on its own task, until kappa is 0.
    """

    advice: ClassVar[Any] = "trainables.learners.baselines.source_replay:SourceReplay"

    source_transitions: Count = 10_000
    """Transitions collected on the source task before training; they take no step on the target task."""
    source_epsilon: Probability = 0.1
    """epsilon of the source's policy there."""


REPLAY_SEED = Agent(
    "replay_seed",
    "DQN with half of each minibatch from the source's transitions, for a while",
    ReplaySeed,
    "dqn",
    LEARNER,
    "deep",
    shown=("advice_fraction",),
    look="moss",
    plots=(KAPPA,),
)
