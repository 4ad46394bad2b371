"""One step function for every tabular task, compiled once, and the Gymnasium environment around it."""

from __future__ import annotations

from typing import Any

import gymnasium
import numpy as np
from gymnasium import spaces
from gymnasium.wrappers import TimeLimit
from numpy.typing import NDArray

from trainables.numerics.jit import compiled
from trainables.tasks.builtin import from_model, supply_chain_model, windy_gridworld_model
from trainables.tasks.spec.tabular_model import Dynamics


@compiled
def step(
    kind: int, state: int, action: int, parameters: NDArray[np.float64], rng: np.random.Generator
) -> tuple[int, float, bool]:
    """Take a step of the task `kind`; return (next state, reward, terminated)."""
    if kind == windy_gridworld_model.KIND:
        return windy_gridworld_model.step(state, action, parameters, rng)
    if kind == from_model.KIND:
        return from_model.step(state, action, parameters, rng)
    return supply_chain_model.step(state, action, parameters, rng)


class TabularEnv(gymnasium.Env[Any, Any]):
    """A tabular task as a Gymnasium environment: observations 0..S-1, actions 0..A-1."""

    metadata = {"render_modes": []}  # noqa: RUF012 (Gymnasium declares it on the instance)

    def __init__(self, dynamics: Dynamics) -> None:
        self._dynamics = dynamics
        self._state = dynamics.start
        self.observation_space = spaces.Discrete(dynamics.states)
        self.action_space = spaces.Discrete(dynamics.actions)

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[int, dict[str, Any]]:
        """Return to the start state."""
        super().reset(seed=seed, options=options)
        self._state = self._dynamics.start
        return self._state, {}

    def step(self, action: int) -> tuple[int, float, bool, bool, dict[str, Any]]:
        """Take a step with the function that the compiled training loop calls."""
        self._state, reward, terminated = step(
            self._dynamics.kind, self._state, int(action), self._dynamics.parameters, self.np_random
        )
        return self._state, reward, terminated, False, {}


def make(dynamics: Dynamics) -> gymnasium.Env[Any, Any]:
    """Return the environment of `dynamics`, truncated at its time limit."""
    return TimeLimit(TabularEnv(dynamics), dynamics.time_limit)
