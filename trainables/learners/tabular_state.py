"""Training and checkpointing of tabular learners, whose compiled loops update arrays in place."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from trainables.agents.builtin.q_learning import QLearning


class InPlace(ABC):
    """Implements `run`, `state` and `restore` for a learner that consists of arrays, random streams and counters."""

    _settings: QLearning
    _env_rng: np.random.Generator
    _explore_rng: np.random.Generator
    _episode: int
    _training_return: float | None
    _seen: tuple[int, int]

    @abstractmethod
    def _train(self, numbers: NDArray[np.int64], epsilons: NDArray[np.float64]) -> float:
        """Train for the episodes of these numbers, with epsilon in each; return the sum of their returns."""

    @abstractmethod
    def _arrays(self) -> dict[str, NDArray[Any]]:
        """Return every array that training changes, by name."""

    def run(self, episodes: int) -> None:
        """Train for `episodes` more episodes."""
        numbers = np.arange(self._episode, self._episode + episodes)
        epsilons = np.maximum(self._settings.epsilon_start - self._settings.epsilon_decay * numbers, 0.0)
        self._training_return = self._train(numbers, epsilons) / episodes
        self._episode += episodes

    def state(self) -> dict[str, Any]:
        """Return everything on which further training depends, between two episodes."""
        return {
            "arrays": {name: array.copy() for name, array in self._arrays().items()},
            "rngs": [rng.bit_generator.state for rng in (self._env_rng, self._explore_rng)],
            "episode": self._episode,
            "training_return": self._training_return,
            "seen": self._seen,
        }

    def restore(self, state: Mapping[str, Any]) -> None:
        """Restore what `state` returned; training then continues bit for bit as before."""
        for name, array in self._arrays().items():
            array[...] = state["arrays"][name]
        for rng, saved in zip((self._env_rng, self._explore_rng), state["rngs"], strict=True):
            rng.bit_generator.state = saved
        self._episode, self._training_return = state["episode"], state["training_return"]
        steps, followed = state["seen"]
        self._seen = steps, followed
