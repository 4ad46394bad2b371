"""Deep Q-learning, the base of every deep agent."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import Annotated, Any, ClassVar, Literal, Self

from pydantic import Field, model_validator

from trainables.agents.agent import Agent
from trainables.agents.base import Count, Hyperparameters, Positive, Probability, Rate


class DQN(Hyperparameters):
    """Deep Q-learning (Table 6); tasks set the paper's values for them."""

    advice: ClassVar[Any] = "trainables.learners.advice:Advice"
    """The strategy that uses the source: a class like those of `trainables.learners.advice`, or its `module:Class`."""

    unwritten: ClassVar[Mapping[str, Any]] = MappingProxyType({"double": False})

    evaluate_every: Count = 100
    """Episodes between greedy evaluations. There is one before training, and one after the last episode."""
    evaluation_episodes: Count = 50
    """Greedy episodes of one evaluation."""
    learning_rate: Rate = 1e-4
    """Adam's step size."""
    hidden_layers: Annotated[int, Field(ge=1, le=64)] = 2
    """Hidden layers (Table 6)."""
    hidden_size: Annotated[int, Field(ge=1, le=8192)] = 256
    """Units of each hidden layer, with ReLU."""
    batch_size: Annotated[int, Field(ge=1, le=65_536)] = 128
    """Transitions per update. There is one update per environment step once the replay buffer has that many."""
    replay_capacity: Annotated[int, Field(ge=1, le=10_000_000)] = 10_000
    """Transitions in the replay buffer; the oldest are overwritten."""
    target_update: Count = 1000
    """Environment steps between copies to the target network."""
    max_gradient_norm: Positive = 10.0
    """Largest norm of the gradient; a larger one is scaled down."""
    loss: Literal["squared", "huber"] = "squared"
    """Loss of the TD error."""
    double: bool = False
    """Whether Q itself chooses the action whose value the target network gives for a target: double DQN (van
    Hasselt, Guez and Silver, "Deep Reinforcement Learning with Double Q-learning", AAAI 2016)."""
    epsilon_start: Probability = 1.0
    """epsilon at the start (Table 6)."""
    epsilon_end: Probability = 0.01
    """epsilon in the limit (Table 6)."""
    epsilon_decay: Positive = 500.0
    """epsilon = epsilon_end + (epsilon_start - epsilon_end) exp(-n / epsilon_decay)."""
    epsilon_unit: Literal["episodes", "steps"] = "episodes"
    """The unit of n. Episodes reproduce the paper's results of DQN, steps do not."""
    truncation: Literal["bootstrap", "terminal"] = "bootstrap"
    """Whether the step that reaches the time limit bootstraps, or counts as terminal."""
    module: str = ""
    """`module:factory` of a torch module, called as factory(inputs, actions); empty: the built-in perceptron."""
    device: Literal["cpu", "cuda"] = "cpu"
    """The device of torch; on the CPU the built-in perceptron uses compiled kernels instead."""

    @property
    def epsilon_schedule(self) -> tuple[float, float]:
        """Return (epsilon at the start, its decay)."""
        return self.epsilon_start, self.epsilon_decay

    @model_validator(mode="after")
    def _batch_fits(self) -> Self:
        if self.batch_size > self.replay_capacity:
            raise ValueError(f"batch_size {self.batch_size} must be at most replay_capacity {self.replay_capacity}")
        return self


LEARNER = "trainables.learners.dqn:DeepLearner"
"""The learner that all deep agents share: the loop of Algorithm 2."""

DQN_AGENT = Agent("dqn", "deep Q-learning without transfer", DQN, None, LEARNER, "deep", usual=True, look="grey")
