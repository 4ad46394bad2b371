"""Algorithm 2 with a factor that has no unit."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import Any, ClassVar, Literal

from trainables.agents.agent import Agent
from trainables.agents.base import Count
from trainables.agents.builtin.dqn import LEARNER
from trainables.agents.builtin.explicit_shaping import DeltaShaping
from trainables.agents.plots import DELTA_FACTOR, DELTA_P90, KAPPA


class RelativeShaping(DeltaShaping):
    """delta_es with a factor without a unit; beyond the paper.

    The paper's exp(-max |delta|) changes with the unit of the rewards, and what the source errs by on its own task
    counts as a difference of the tasks. Here that error is taken off, and the rest is divided by the range of A_src.
    """

    advice: ClassVar[Any] = "trainables.learners.baselines.relative:RelativeDelta"
    unwritten: ClassVar[Mapping[str, Any]] = MappingProxyType({})

    floor: Literal["quantile", "state"] = "quantile"
    """What is taken off: the 90 % quantile of delta's size on the source's own task, or that delta, state by state."""
    floor_updates: Count = 2000
    """Minibatches that the delta of the source's own task is trained with, before the first episode."""


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
