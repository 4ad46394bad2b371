"""The hyperparameters of each agent: their ranges, the paper's values, and the meaning of each."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field

Rate = Annotated[float, Field(gt=0, le=1, allow_inf_nan=False)]
Probability = Annotated[float, Field(ge=0, le=1, allow_inf_nan=False)]
NonNegative = Annotated[float, Field(ge=0, allow_inf_nan=False)]
Positive = Annotated[float, Field(gt=0, allow_inf_nan=False)]
Count = Annotated[int, Field(ge=1)]


class Hyperparameters(BaseModel):
    """What every agent has. Wrong keys and types are refused; numbers are not read from text."""

    model_config = ConfigDict(frozen=True, extra="forbid", strict=True, use_attribute_docstrings=True)

    episodes: Count = 1000
    """Training episodes (Table 4)."""
    evaluate_every: Count = 10
    """Episodes between greedy evaluations; one is made before training and one after the last episode."""
    gamma: Annotated[float, Field(ge=0, lt=1, allow_inf_nan=False)] = 0.99
    """Discount factor (Table 4)."""


class QLearning(Hyperparameters):
    """Q-learning, eq. (1)."""

    learning_rate: Rate = 0.5
    """alpha (Table 4)."""
    epsilon_start: Probability = 0.1
    """epsilon in the first episode (Table 4)."""
    epsilon_decay: NonNegative = 5e-4
    """epsilon_e = max(epsilon_start - epsilon_decay * e, 0), constant within episode e (Table 4)."""
    truncation: Literal["bootstrap", "terminal"] = "bootstrap"
    """Whether the step that reaches the time limit bootstraps or is learned from as if it were terminal."""


class Transfer(QLearning):
    """A Q-learner with a source; it estimates delta whatever it does with it."""

    delta_learning_rate: Rate = 0.05
    """alpha_d of eq. (2) (Table 5)."""


class ProbabilisticPolicyReuse(Transfer):
    """PPR: each step takes the source's action with probability psi."""

    psi_start: Probability = 1.0
    """psi in the first episode."""
    nu: Probability = 0.99
    """psi is multiplied by nu after each episode (Appendix C)."""


class DeltaGate(Transfer):
    """Algorithm 1."""

    threshold: NonNegative = 10.0
    """Delta: the gate is open iff no |delta(s,a)| exceeds it (Table 5)."""


class ConfidenceGate(Transfer):
    """Algorithm 1 with a gate that asks for significance, not for size alone; beyond the paper."""

    threshold: NonNegative = 1.0
    """Delta: the gate closes iff some |mean| - z se exceeds it."""
    z: NonNegative = 3.0
    """Standard errors that are given to chance."""
    min_visits: Annotated[int, Field(ge=2)] = 5
    """Visits before a pair counts."""
    sd_floor: Positive = 0.3
    """se = max(sd, sd_floor) / sqrt(n)."""
