"""A gated initialisation with the source's values."""

from __future__ import annotations

from typing import Annotated, Any, ClassVar

from pydantic import Field

from trainables.agents.agent import Agent
from trainables.agents.base import Count
from trainables.agents.builtin.dqn import DQN, LEARNER
from trainables.agents.plots import KNOWN


class GatedInit(DQN):
    """A mixture of the source's values with Q, whose share grows with the visits to a state (after DQInit, arXiv
    2508.09277, which transfers the values of tables of solved tasks; here they are those of Q_src).
    """

    advice: ClassVar[Any] = "trainables.learners.baselines.gated_init:GatedInit"

    bins: Annotated[int, Field(ge=2)] = 4
    """Bins of each input, by its quantiles on the source task."""
    known_after: Count = 20
    """Visits after which a bin uses Q alone."""


DQINIT = Agent(
    "dqinit",
    "DQN on the source's values where the target is not yet known",
    GatedInit,
    "dqn",
    LEARNER,
    "deep",
    shown=("known_after",),
    look="slate",
    plots=(KNOWN,),
)
