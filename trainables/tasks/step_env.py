"""A fast interface to a task's environment for deep agents: float32 vectors, integer actions, no wrappers."""

from __future__ import annotations

from typing import Any

import gymnasium
import numpy as np
from gymnasium.spaces import Box, Discrete

from trainables.errors import InputError
from trainables.numerics.matmul import F32
from trainables.tasks.simulators.registry import simulator_of, start
from trainables.tasks.simulators.simulator import step
from trainables.tasks.wrappers.unwrap import unwrap


class _Unchecked(Discrete):
    """An action space without the check of every action, which takes as long as the physics of a step."""

    def contains(self, x: Any) -> bool:
        """Return True, since an action from an argmax is in range."""
        return True


class Environment:
    """One environment. Each episode has a separate seed, so no state of the environment outlives an episode.

    If the environment has a compiled simulator, that takes the steps: the same bits in a fraction of the time.
    """

    def __init__(self, env: gymnasium.Env, simulated: bool = True) -> None:
        """Raise InputError for actions that are not discrete. simulated: whether a simulator may take the steps."""
        if not isinstance(env.action_space, Discrete):
            raise InputError(f"the environment's actions are not discrete ({env.action_space})")
        self.actions = int(env.action_space.n)
        self._first = int(env.action_space.start)
        self._space = env.observation_space
        self.inputs = int(gymnasium.spaces.flatdim(self._space))
        self._plain = isinstance(self._space, Box) and self._space.shape == (self.inputs,)
        self._env, self.time_limit = unwrap(env)
        self._env.action_space = _Unchecked(self.actions, start=self._first)
        self._left = self.time_limit
        self.simulator = simulator_of(self._env, self._first, self.actions) if simulated and self._plain else None
        """The compiled simulator; None where the environment itself takes the steps."""
        self.state = np.zeros(0)
        """(k,): the state of the simulator, if there is one."""
        self._observation = np.zeros(self.inputs, np.float32)

    def close(self) -> None:
        """Close the environment."""
        self._env.close()

    def reset(self, seed: int) -> F32:
        """Return the first observation (inputs,) of a new episode."""
        self._left = self.time_limit
        if self.simulator is not None:
            observation, self.state = start(self._env, seed)
        else:
            observation, _ = self._env.reset(seed=seed)
        return self._vector(observation)

    def step(self, action: int) -> tuple[F32, float, bool, bool]:
        """Return (next observation (inputs,), reward, terminated, truncated); the time limit truncates."""
        self._left -= 1
        if self.simulator is not None:
            kind, parameters, controls = self.simulator.physics
            gain, end = step(kind, parameters, controls[action], self.state, self._observation)
            return self._observation.copy(), gain, end, self._left <= 0
        observation, reward, terminated, truncated, _ = self._env.step(action + self._first)
        return self._vector(observation), float(reward), bool(terminated), bool(truncated) or self._left <= 0

    def _vector(self, observation: Any) -> F32:
        if not self._plain:
            observation = gymnasium.spaces.flatten(self._space, observation)
        return np.array(observation, dtype=np.float32)
