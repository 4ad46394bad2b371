"""Algorithm 1: the paper's gate, by the size of delta, and a gate that requires significance."""

from __future__ import annotations

import math
from typing import Annotated, Literal

from pydantic import BeforeValidator, Field

from trainables.agents.agent import Agent
from trainables.agents.base import NonNegative, Positive
from trainables.agents.builtin.q_learning import LEARNER, Transfer
from trainables.agents.plots import GATE_OPEN, MAX_DELTA


def _threshold(value: object) -> object:
    number = isinstance(value, int | float) and not isinstance(value, bool)
    if value != "auto" and not (number and 0 <= float(str(value)) < math.inf):
        raise ValueError(f"must be a finite number of at least 0, or auto (got {value!r})")
    return value


Threshold = Annotated[float | Literal["auto"], BeforeValidator(_threshold)]
"""auto: the noise floor of the source, which is its delta on its own task (`delta.noise_floor`)."""


class Gated(Transfer):
    """What both gates share."""

    reuse = "gate"

    @property
    def fixed_length(self) -> str:
        """Return why a gate whose threshold is measured depends on the number of episodes."""
        auto = getattr(self, "threshold", None) == "auto"
        return "threshold: auto is measured over as many episodes as the cell has" if auto else ""


class DeltaGate(Gated):
    """Algorithm 1."""

    threshold: Threshold = 10.0
    """Delta: the gate is open iff no |delta(s,a)| exceeds it (Table 5); auto: the source's noise floor."""


class ConfidenceGate(Gated):
    """Algorithm 1 with a gate that requires |delta| to be significantly large; beyond the paper."""

    threshold: Threshold = 1.0
    """Delta: the gate closes iff some |mean| - z se exceeds it; auto: the source's noise floor."""
    z: NonNegative = 3.0
    """Standard errors subtracted from |mean|."""
    min_visits: Annotated[int, Field(ge=2)] = 5
    """Visits before a state-action pair counts."""
    sd_floor: Positive = 0.3
    """se = max(sd, sd_floor) / sqrt(n)."""


DELTA_GATE = Agent(
    "delta_gate",
    "Algorithm 1: the source policy while max |delta| <= threshold",
    DeltaGate,
    "q_learning",
    LEARNER,
    rivals=("ppr", "policy_reuse"),
    shown=("threshold",),
    usual=True,
    algorithm=1,
    look="vermilion",
    plots=(GATE_OPEN, MAX_DELTA),
    no_task_default=(),
)

CONFIDENCE_GATE = Agent(
    "confidence_gate",
    "Algorithm 1 with a gate that requires significance",
    ConfidenceGate,
    "q_learning",
    LEARNER,
    rivals=("delta_gate",),
    shown=("threshold",),
    usual=True,
    look="green",
    plots=(GATE_OPEN, MAX_DELTA),
)
