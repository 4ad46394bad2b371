"""Algorithm 2 with a dimensionless factor."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, ClassVar, Literal

from trainables.agents.agent import Agent
from trainables.agents.base import Count
from trainables.agents.builtin.dqn import DQN, LEARNER
from trainables.agents.builtin.explicit_shaping import DeltaShaping
from trainables.agents.plots import DELTA_FACTOR, DELTA_P90, KAPPA


class RelativeShaping(DeltaShaping):
    """delta_es with a dimensionless factor; beyond the paper.

    The paper's exp(-max |delta|) depends on the unit of the rewards, and counts the source's error on its own task as a
    difference between the tasks. Here that error is subtracted, and the rest divided by the range of A_src.
    """

    advice: ClassVar[Any] = "trainables.learners.baselines.relative:RelativeDelta"
    unwritten: ClassVar[Mapping[str, Any]] = DQN.unwritten

    floor: Literal["quantile", "state"] = "quantile"
    """What is subtracted: the 90 % quantile of |delta| on the source's own task, or that delta in each state."""
    floor_updates: Count = 2000
    """Minibatches for training delta on the source's own task, before the first episode."""


RELATIVE_ES = Agent(
    "relative_es",
    "Algorithm 2 with delta over the source's own error, in units of A_src's range",
    RelativeShaping,
    "dqn",
    LEARNER,
    "deep",
    shown=("advice_fraction", "floor"),
    look="violet",
    plots=(KAPPA, DELTA_FACTOR, DELTA_P90),
)
