"""Explicit shaping by one of the sources of a library."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import Any, ClassVar, Literal

from trainables.agents.agent import Agent
from trainables.agents.base import Count, NonNegative
from trainables.agents.builtin.dqn import DQN
from trainables.agents.builtin.explicit_shaping import ExplicitShaping
from trainables.agents.plots import ADVICE_FACTOR, KAPPA


class DeltaSelectShaping(ExplicitShaping):
    """Explicit shaping by the source of a library with the smallest delta, or by none; beyond the paper."""

    unwritten: ClassVar[Mapping[str, Any]] = MappingProxyType({**DQN.unwritten, "floor": "greedy"})

    threshold: NonNegative = 1.0
    """A source gives advice only while its delta exceeds the delta on its own task by at most this."""
    z: NonNegative = 3.0
    """Standard errors over episodes that are subtracted from the excess of delta."""
    floor: Literal["exploring", "greedy"] = "exploring"
    """How delta on the source's own task is measured: with the same exploration as in the target's transitions, so that
    the two are comparable, or greedily."""
    memory: Count = 100
    """Episodes after which the weight of a sample of delta has fallen to 1/e."""


DELTA_SELECT_ES = Agent(
    "delta_select_es",
    "explicit shaping by that of several sources whose delta is smallest, or none",
    DeltaSelectShaping,
    "dqn",
    "trainables.learners.delta_select_es:DeepSelectLearner",
    "deep",
    several=True,
    shown=("advice_fraction", "threshold"),
    look="green",
    plots=(KAPPA, ADVICE_FACTOR),
)
