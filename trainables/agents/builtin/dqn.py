"""Deep Q-learning, the base of every deep agent."""

from __future__ import annotations

from typing import Annotated, Any, ClassVar, Literal, Self

from pydantic import Field, model_validator

from trainables.agents.agent import Agent
from trainables.agents.base import Count, Hyperparameters, Positive, Probability, Rate


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
    hidden_layers: Annotated[int, Field(ge=1, le=64)] = 2
    """Hidden layers (Table 6)."""
    hidden_size: Annotated[int, Field(ge=1, le=8192)] = 256
    """Units of each hidden layer, with ReLU."""
    batch_size: Annotated[int, Field(ge=1, le=65_536)] = 128
    """Transitions of one update; one update is made per environment step once that many are there."""
    replay_capacity: Annotated[int, Field(ge=1, le=10_000_000)] = 10_000
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

    @property
    def epsilon_schedule(self) -> tuple[float, float]:
        """Epsilon at the start, and its decay."""
        return self.epsilon_start, self.epsilon_decay

    @model_validator(mode="after")
    def _batch_fits(self) -> Self:
        if self.batch_size > self.replay_capacity:
            raise ValueError(f"batch_size {self.batch_size} must be at most replay_capacity {self.replay_capacity}")
        return self


LEARNER = "trainables.learners.dqn:DeepLearner"
"""The loop of Algorithm 2, which all deep agents share."""

DQN_AGENT = Agent("dqn", "deep Q-learning without transfer", DQN, None, LEARNER, "deep", usual=True, look="grey")
