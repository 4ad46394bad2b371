"""Transitions from episodes of a deep task."""

from __future__ import annotations

from typing import Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from trainables.tasks.make import make_env
from trainables.tasks.spec.family import Task
from trainables.tasks.step_env import Environment


class Rollout:
    """Plays whole episodes in one environment, which is closed at the end of the context."""

    def __init__(self, task: Task, rng: np.random.Generator) -> None:
        self._env, self._rng = Environment(make_env(task)), rng

    def __enter__(self) -> Rollout:
        return self

    def __exit__(self, *error: object) -> None:
        self.close()

    def close(self) -> None:
        """Close the environment."""
        self._env.close()

    @property
    def shape(self) -> tuple[int, int]:
        """(inputs, actions) of the task."""
        return self._env.inputs, self._env.actions

    def episode(self, source: Values | None, epsilon: float = 0.0) -> Transitions:
        """Play an episode of the source's epsilon-greedy policy, or of random actions without a source."""
        observation = self._env.reset(int(self._rng.integers(2**31)))
        steps: list[tuple[Any, ...]] = []
        done = False
        while not done:
            explores = source is None or (epsilon > 0 and self._rng.random() < epsilon)
            greedy = None if source is None or explores else int(source.rows(observation[None])[0].argmax())
            action = int(self._rng.integers(self._env.actions)) if greedy is None else greedy
            after, reward, terminated, truncated = self._env.step(action)
            steps.append((observation, action, reward, after, terminated))
            observation, done = after, terminated or truncated
        columns = list(zip(*steps, strict=True))
        return Transitions(
            np.stack(columns[0]),
            np.array(columns[1], np.int64),
            np.array(columns[2], np.float32),
            np.stack(columns[3]),
            np.array(columns[4], np.bool_),
        )


F32 = NDArray[np.float32]


class Values(Protocol):
    """The interface of a source network here."""

    def rows(self, observations: F32) -> F32:
        """Return Q(s, .) (n, actions) at observations (n, inputs)."""


class Transitions(NamedTuple):
    """n transitions."""

    observations: F32
    """(n, inputs)."""
    actions: NDArray[np.int64]
    """(n,)."""
    rewards: F32
    """(n,)."""
    next_observations: F32
    """(n, inputs)."""
    terminated: NDArray[np.bool_]
    """(n,)."""
