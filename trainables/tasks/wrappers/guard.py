"""Checks a custom environment while it runs; a violation is one sentence with the line of its code."""

from __future__ import annotations

import inspect
import math
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
from gymnasium.spaces import Box, Discrete
from gymnasium.wrappers import TimeLimit

from trainables.plugins.loader import CustomCodeError, is_custom
from trainables.plugins.names import short
from trainables.tasks.wrappers.unwrap import unwrap


class Guard(gymnasium.Wrapper[Any, Any, Any, Any]):
    """Raises CustomCodeError for observations of another shape than the space's, and for NaN and infinities."""

    def __init__(self, env: gymnasium.Env[Any, Any], name: str) -> None:
        super().__init__(env)
        self._name = short(name)
        space = env.observation_space
        self._shape = space.shape if isinstance(space, Box) else None

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Any, dict[str, Any]]:
        """Reset the environment, and check its observation."""
        observation, info = self.env.reset(seed=seed, options=options)
        self._check("reset", observation)
        return observation, info

    def step(self, action: Any) -> tuple[Any, Any, bool, bool, dict[str, Any]]:
        """Step the environment, and check its observation and reward."""
        result = self.env.step(action)
        self._check("step", result[0])
        try:
            finite = math.isfinite(result[1])
        except (TypeError, ValueError):
            finite = False
        if not finite:
            self._refuse("step", f"the reward is {result[1]}, not a finite number")
        return result

    def _check(self, method: str, observation: Any) -> None:
        if self._shape is None:
            if not self.env.observation_space.contains(observation):
                self._refuse(method, f"the observation {observation!r} is not in {self.env.observation_space}")
            return
        values = np.asarray(observation)
        if values.shape != self._shape:
            self._refuse(method, f"the observation has shape {values.shape}, its space says {self._shape}")
        if not np.isfinite(values).all():
            self._refuse(method, "the observation holds a NaN or an infinity")

    def _refuse(self, method: str, why: str) -> None:
        raise CustomCodeError(f"{self._name}: {why}{place(self.env, method)}")


def guarded(env: gymnasium.Env[Any, Any], name: str) -> gymnasium.Env[Any, Any]:
    """Return the environment behind a Guard. Raises CustomCodeError for unsupported spaces and for no time limit."""
    if not isinstance(env, gymnasium.Env):
        raise CustomCodeError(f"{short(name)}: its factory returned {env!r}, not a gymnasium.Env")
    name, where = short(name), place(env, "__init__")
    if isinstance(env.action_space, Box):
        raise CustomCodeError(f"{name}: its actions are continuous ({env.action_space}): declare levels=3, say{where}")
    if not isinstance(env.action_space, Discrete):
        raise CustomCodeError(f"{name}: only Discrete and Box actions can be learned, not {env.action_space}{where}")
    try:
        size = gymnasium.spaces.flatdim(env.observation_space)
    except (NotImplementedError, ValueError):
        size = 0
    if not size:
        raise CustomCodeError(
            f"{name}: its observations are not vectors of a fixed length ({env.observation_space}){where}"
        )
    limits = [int(layer._max_episode_steps) for layer in layers(env) if isinstance(layer, TimeLimit)]
    if not limits:
        raise CustomCodeError(f"{name}: its episodes have no time limit: declare limit=200, say{where}")
    return TimeLimit(Guard(unwrap(env)[0], name), min(limits))


def layers(env: gymnasium.Env[Any, Any]) -> Iterator[gymnasium.Env[Any, Any]]:
    """Yield the environment and what it wraps, from the outside in."""
    yield env
    while isinstance(env, gymnasium.Wrapper):
        env = env.env
        yield env


def place(env: gymnasium.Env[Any, Any], method: str) -> str:
    """Return ' (FILE:LINE)' of a method of custom code; empty where no layer of the environment is custom."""
    for layer in layers(env):
        code = getattr(inspect.unwrap(getattr(type(layer), method)), "__code__", None)
        if code is not None and is_custom(code.co_filename):
            return f" ({Path(code.co_filename).name}:{code.co_firstlineno})"
    return ""
