"""MountainCar: the arithmetic of gymnasium.envs.classic_control.mountain_car, operation for operation."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from trainables.numerics.jit import compiled


def parameters(env: Any) -> list[float]:
    """Return the parameters of `step`."""
    return [
        env.gravity,
        env.max_speed,
        env.min_position,
        env.max_position,
        env.goal_position,
        env.goal_velocity,
    ]


def control(env: Any, action: Any) -> list[float]:
    """Return what an action adds to the velocity."""
    return [(action - 1) * env.force]


@compiled
def _clip(x: float, low: float, high: float) -> float:
    x = low if x < low else x
    return high if x > high else x


@compiled
def step(
    p: NDArray[np.float64], control: NDArray[np.float64], state: NDArray[np.float64], observation: NDArray[np.float32]
) -> tuple[float, bool]:
    """Step `state` (position, velocity) and `observation` (2,) in place; return (reward, terminated)."""
    position, velocity = state[0], state[1]
    velocity = velocity + (control[0] + math.cos(3 * position) * (-p[0]))
    velocity = _clip(velocity, -p[1], p[1])
    position = _clip(position + velocity, p[2], p[3])
    if position == p[2] and velocity < 0:
        velocity = 0.0
    state[0], state[1] = position, velocity
    observation[0], observation[1] = position, velocity
    return -1.0, position >= p[4] and velocity >= p[5]
