"""The tabular agent that chooses among the sources of a library."""

from __future__ import annotations

from trainables.agents.agent import Agent
from trainables.agents.base import NonNegative, Positive, Probability, Rate
from trainables.agents.builtin.q_learning import QLearning
from trainables.agents.plots import SOURCE_ACTION


class DeltaSelect(QLearning):
    """Follows the source of a library with the smallest delta along its own path, or none; beyond the paper."""

    practice: Probability = 0.5
    """Share of the episodes that Q_trg plays itself, however good a source is."""
    z: NonNegative = 3.0
    """Standard errors added to the estimate of a source, as an optimistic bound."""
    sd_floor: Positive = 0.3
    """se = max(sd, sd_floor) / sqrt(n), with the standard deviation over the episodes of all sources."""
    keep: Probability = 0.5
    """Share of its predicted advantage over an untrained Q_trg that a source must keep to be followed."""
    own_rate: Rate = 0.05
    """Rate of the running mean of Q_trg's returns, which a source must exceed."""


DELTA_SELECT = Agent(
    "delta_select",
    "of several sources the one with the smallest delta along its own path, or none",
    DeltaSelect,
    "q_learning",
    "trainables.learners.delta_select:SelectLearner",
    several=True,
    look="sky",
    plots=(SOURCE_ACTION,),
)
