"""Explicit shaping by the source's values, corrected by delta."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, ClassVar

from trainables.agents.agent import Agent
from trainables.agents.builtin.dqn import DQN, LEARNER
from trainables.agents.builtin.explicit_shaping import DeltaShaping
from trainables.agents.plots import CORRECTED, DELTA_P90, KAPPA


class CorrectedShaping(DeltaShaping):
    """Explicit shaping by the advantage of Q_src + delta, an estimate of E_trg[r + gamma V_src(s')], where delta_es has
    the factor exp(-max |delta|); beyond the paper.
    """

    advice: ClassVar[Any] = "trainables.learners.baselines.corrected:CorrectedAdvice"
    unwritten: ClassVar[Mapping[str, Any]] = DQN.unwritten


CORRECTED_ES = Agent(
    "corrected_es",
    "explicit shaping by the advantage of Q_src + delta",
    CorrectedShaping,
    "dqn",
    LEARNER,
    "deep",
    shown=("advice_fraction",),
    look="olive",
    plots=(KAPPA, CORRECTED, DELTA_P90),
)
