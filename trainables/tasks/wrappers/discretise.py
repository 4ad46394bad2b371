"""Discretises continuous actions: `levels` evenly spaced values per dimension, and every combination is an action."""

from __future__ import annotations

from typing import Any

import gymnasium
import numpy as np
from gymnasium.spaces import Box, Discrete
from gymnasium.wrappers import TimeLimit
from numpy.typing import NDArray

from trainables.errors import InputError
from trainables.tasks.spec.family import ContextFeature, number
from trainables.tasks.wrappers.unwrap import NO_LIMIT, unwrap

LIMIT = 1024
"""Largest number of actions, since the agent learns a value for each."""


def levels_feature(default: float) -> ContextFeature:
    """Return the feature that sets the number of levels, for tasks with continuous actions."""
    return ContextFeature("levels", default, "values of each dimension of the action", number(2, LIMIT))


def action_table(space: gymnasium.Space[Any], levels: float) -> NDArray[Any]:
    """Return (n, dimensions), the continuous action of each discrete one; the last dimension changes fastest.

    Raises InputError for a space that is no Box, has no bounds, or would have more than LIMIT actions.
    """
    if not isinstance(space, Box):
        raise InputError(f"only Discrete and Box actions can be learned, not {space}")
    if not np.isfinite(space.low).all() or not np.isfinite(space.high).all():
        raise InputError(f"actions without bounds cannot be cut into levels ({space})")
    if levels != int(levels):
        raise InputError(f"levels must be a whole number (got {levels:g})")
    dimensions = int(np.prod(space.shape))
    count = int(levels) ** dimensions
    if count > LIMIT:
        raise InputError(
            f"levels={levels:g} in {dimensions} dimensions are {count} actions, more than {LIMIT}{_most(dimensions)}"
        )
    axes = np.linspace(space.low.ravel(), space.high.ravel(), int(levels), dtype=space.dtype).T
    grid = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)
    return grid.reshape(count, *space.shape)


def _most(dimensions: int) -> str:
    most = next((n for n in range(LIMIT, 1, -1) if n**dimensions <= LIMIT), None)
    return f": levels={most} are {most**dimensions}" if most else ": there are too many dimensions for two levels each"


class Discretised(gymnasium.Wrapper[Any, Any, Any, Any]):
    """An environment whose action is a row of `action_table`."""

    def __init__(self, env: gymnasium.Env[Any, Any], levels: float) -> None:
        super().__init__(env)
        self.table = action_table(env.action_space, levels)
        self.action_space = Discrete(len(self.table))

    def step(self, action: Any) -> tuple[Any, Any, bool, bool, dict[str, Any]]:
        """Take a step with the continuous action of `action`."""
        return self.env.step(self.table[action].copy())


def discretise(env: gymnasium.Env[Any, Any], levels: float) -> gymnasium.Env[Any, Any]:
    """Return the environment with discrete actions, its time limit outermost."""
    inner, limit = unwrap(env)
    wrapped = Discretised(inner, levels)
    return wrapped if limit == NO_LIMIT else TimeLimit(wrapped, limit)
