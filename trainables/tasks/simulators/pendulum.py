"""Pendulum under discrete torques: the arithmetic of gymnasium.envs.classic_control, operation for operation."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from trainables.numerics.jit import compiled


def parameters(env: Any) -> list[float]:
    """Return the parameters of `step`."""
    return [3 * env.g / (2 * env.l), env.dt, env.max_speed, 2.0]


def control(env: Any, action: Any) -> list[float]:
    """Return what a torque (1,) adds to the acceleration and to the costs: 32-bit numbers, like the torque."""
    u = np.clip(action, -env.max_torque, env.max_torque)[0]
    return [3.0 / (env.m * env.l**2) * u, 0.001 * (u**2)]


@compiled
def step(
    p: NDArray[np.float64], control: NDArray[np.float64], state: NDArray[np.float64], observation: NDArray[np.float32]
) -> tuple[float, bool]:
    """Step `state` (theta, its velocity) and `observation` (3,) in place; return (reward, False)."""
    theta, velocity = state[0], state[1]
    dt, most, two = p[1], p[2], p[3]  # a power of a constant would become a product, with different rounding
    angle = (theta + math.pi) % (2 * math.pi) - math.pi
    costs = angle**two + 0.1 * velocity**two + control[1]

    velocity = velocity + (p[0] * math.sin(theta) + control[0]) * dt
    velocity = -most if velocity < -most else velocity
    velocity = most if velocity > most else velocity
    theta = theta + velocity * dt

    state[0], state[1] = theta, velocity
    observation[0], observation[1], observation[2] = math.cos(theta), math.sin(theta), velocity
    return -costs, False
