"""Saving and restoring the tabular learners, whose compiled loops change their arrays where they are."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray


class InPlace(ABC):
    """`state` and `restore` of a learner that is its arrays, its random streams and where it stands."""

    _env_rng: np.random.Generator
    _explore_rng: np.random.Generator
    _episode: int
    _training_return: float | None
    _seen: tuple[int, int]

    @abstractmethod
    def _arrays(self) -> dict[str, NDArray[Any]]:
        """Every array that training changes, by name."""

    def state(self) -> dict[str, Any]:
        """Everything that decides how training goes on, between two episodes."""
        return {
            "arrays": {name: array.copy() for name, array in self._arrays().items()},
            "rngs": [rng.bit_generator.state for rng in (self._env_rng, self._explore_rng)],
            "episode": self._episode,
            "training_return": self._training_return,
            "seen": self._seen,
        }

    def restore(self, state: Mapping[str, Any]) -> None:
        """Go back to what `state` returned; what follows is then equal bit for bit."""
        for name, array in self._arrays().items():
            array[...] = state["arrays"][name]
        for rng, saved in zip((self._env_rng, self._explore_rng), state["rngs"], strict=True):
            rng.bit_generator.state = saved
        self._episode, self._training_return = state["episode"], state["training_return"]
        steps, followed = state["seen"]
        self._seen = steps, followed
