"""The hyperparameters of each agent: their ranges, the paper's values, and the meaning of each."""

from __future__ import annotations

import math
from collections.abc import Mapping
from types import MappingProxyType
from typing import Annotated, Any, ClassVar, Literal, Self

from pydantic import BaseModel, BeforeValidator, ConfigDict, Field, model_validator

Rate = Annotated[float, Field(gt=0, le=1, allow_inf_nan=False)]
Probability = Annotated[float, Field(ge=0, le=1, allow_inf_nan=False)]
NonNegative = Annotated[float, Field(ge=0, allow_inf_nan=False)]
Positive = Annotated[float, Field(gt=0, allow_inf_nan=False)]
Count = Annotated[int, Field(ge=1)]


def _threshold(value: object) -> object:
    number = isinstance(value, int | float) and not isinstance(value, bool)
    if value != "auto" and not (number and 0 <= float(str(value)) < math.inf):
        raise ValueError(f"must be a finite number of at least 0, or auto (got {value!r})")
    return value


Threshold = Annotated[float | Literal["auto"], BeforeValidator(_threshold)]
"""auto: the noise floor of the source, what its delta comes to on its own task (`delta.calibration`)."""


class Hyperparameters(BaseModel):
    """What every agent has. Wrong keys and types are refused; numbers are not read from text."""

    model_config = ConfigDict(frozen=True, extra="forbid", strict=True, use_attribute_docstrings=True)

    unwritten: ClassVar[Mapping[str, Any]] = MappingProxyType({})
    """What a cell's JSON leaves out: of a hyperparameter younger than recorded cells, the value that these had."""

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

    threshold: Threshold = 10.0
    """Delta: the gate is open iff no |delta(s,a)| exceeds it (Table 5); auto: the source's own noise floor."""


class ConfidenceGate(Transfer):
    """Algorithm 1 with a gate that asks for significance, not for size alone; beyond the paper."""

    threshold: Threshold = 1.0
    """Delta: the gate closes iff some |mean| - z se exceeds it; auto: the source's own noise floor."""
    z: NonNegative = 3.0
    """Standard errors that are given to chance."""
    min_visits: Annotated[int, Field(ge=2)] = 5
    """Visits before a pair counts."""
    sd_floor: Positive = 0.3
    """se = max(sd, sd_floor) / sqrt(n)."""


class DeltaSelect(QLearning):
    """Follows the source of a library whose delta along its own path is smallest, or none; beyond the paper."""

    practice: Probability = 0.5
    """Share of the episodes that Q_trg plays itself, however good a source is."""
    z: NonNegative = 3.0
    """Standard errors that a source which was followed seldom is given."""
    sd_floor: Positive = 0.3
    """se = max(sd, sd_floor) / sqrt(n), with the standard deviation over the episodes of all sources."""
    keep: Probability = 0.5
    """Share of what a source promises over an untrained Q_trg that it must keep to be followed."""
    own_rate: Rate = 0.05
    """Rate of the running mean of Q_trg's own returns, which a source must exceed."""


class DQN(Hyperparameters):
    """Deep Q-learning (Table 6); a task brings the paper's own values for it."""

    advice: ClassVar[Any] = "trainables.learners.advice:Advice"
    """How the source is used: a class of `trainables.learners.advice`, or the `module:Class` of one."""

    evaluate_every: Count = 100
    """Episodes between greedy evaluations; one is made before training and one after the last episode."""
    evaluation_episodes: Count = 50
    """Greedy episodes of one evaluation."""
    learning_rate: Rate = 1e-4
    """Adam's step size."""
    hidden_layers: Count = 2
    """Hidden layers (Table 6)."""
    hidden_size: Count = 256
    """Units of each hidden layer, with ReLU."""
    batch_size: Count = 128
    """Transitions of one update; one update is made per environment step once that many are there."""
    replay_capacity: Count = 10_000
    """Transitions that are remembered; the oldest are overwritten."""
    target_update: Count = 1000
    """Environment steps between copies to the target network."""
    max_gradient_norm: Positive = 10.0
    """The gradient is scaled down to this norm."""
    loss: Literal["squared", "huber"] = "squared"
    """Of the TD error."""
    epsilon_start: Probability = 1.0
    """epsilon at the start (Table 6)."""
    epsilon_end: Probability = 0.01
    """epsilon that is approached (Table 6)."""
    epsilon_decay: Positive = 500.0
    """epsilon = epsilon_end + (epsilon_start - epsilon_end) exp(-n / epsilon_decay)."""
    epsilon_unit: Literal["episodes", "steps"] = "episodes"
    """What n counts: with episodes DQN's results are the paper's, with steps they are not."""
    truncation: Literal["bootstrap", "terminal"] = "bootstrap"
    """Whether the step that reaches the time limit bootstraps or is learned from as if it were terminal."""
    module: str = ""
    """`module:factory` of a torch module, called as factory(inputs, actions); empty: the built-in perceptron."""
    device: Literal["cpu", "cuda"] = "cpu"
    """Where torch computes; the built-in perceptron on the CPU is the compiled one."""

    @model_validator(mode="after")
    def _batch_fits(self) -> Self:
        if self.batch_size > self.replay_capacity:
            raise ValueError(f"batch_size {self.batch_size} must be at most replay_capacity {self.replay_capacity}")
        return self


class ExplicitShaping(DQN):
    """Explicit shaping: acts on Q(s,a) - kappa_t Phi(s,a), eq. (3), with Phi = -A_src."""

    advice: ClassVar[Any] = "trainables.learners.advice:ExplicitShaping"

    advice_fraction: Rate = 0.25
    """C = 1 / (advice_fraction T): the share of T, the source run's steps, until kappa is 0 (eq. 6)."""
    evaluation_policy: Literal["q", "shaped"] = "q"
    """What greedy evaluation follows: Q alone, or what the agent acts on."""


class DeltaShaping(ExplicitShaping):
    """Algorithm 2: explicit shaping with the factor exp(-max_a |delta(s,a)|), eq. (5)."""

    advice: ClassVar[Any] = "trainables.learners.advice:DeltaShaping"

    unwritten: ClassVar[Mapping[str, Any]] = MappingProxyType({"delta_after_advice": "train"})

    delta_learning_rate: Rate = 5e-4
    """alpha_d, the step size of the delta network (Table 7)."""
    delta_after_advice: Literal["rest", "train"] = "rest"
    """Whether the delta network is trained on once kappa is 0, when it can change no action any more."""


class DeltaSelectShaping(ExplicitShaping):
    """Explicit shaping by the source of a library with the smallest delta, or by none; beyond the paper."""

    threshold: NonNegative = 1.0
    """Advice is taken from a source only while its delta exceeds the delta on its own task by no more than this."""
    z: NonNegative = 3.0
    """Standard errors, over episodes, that delta's excess is given to chance."""
    memory: Count = 100
    """Episodes after which a sample of delta counts for 1/e of a new one."""


class PotentialAdvice(DQN):
    """Potential-based advice: the reward is shaped by the potential A_src of state and action."""

    advice: ClassVar[Any] = "trainables.learners.advice:PotentialAdvice"


class DeltaPotentialAdvice(PotentialAdvice):
    """Potential-based advice with the potential exp(-max_a |delta(s,a)|) A_src(s,a), which follows delta."""

    advice: ClassVar[Any] = "trainables.learners.advice:DeltaPotentialAdvice"

    delta_learning_rate: Rate = 5e-4
    """alpha_d, the step size of the delta network (Table 7)."""
