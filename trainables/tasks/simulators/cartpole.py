"""CartPole: the arithmetic of gymnasium.envs.classic_control.cartpole, operation for operation."""

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
        env.total_mass,
        env.length,
        env.masspole,
        env.polemass_length,
        env.tau,
        env.x_threshold,
        env.theta_threshold_radians,
        env.kinematics_integrator == "euler",
        env._sutton_barto_reward,
    ]


def control(env: Any, action: Any) -> list[float]:
    """Return the force of an action."""
    return [env.force_mag if action == 1 else -env.force_mag]


@compiled
def step(
    p: NDArray[np.float64], control: NDArray[np.float64], state: NDArray[np.float64], observation: NDArray[np.float32]
) -> tuple[float, bool]:
    """Step `state` (x, x_dot, theta, theta_dot) and `observation` (4,) in place; return (reward, terminated)."""
    gravity, total_mass, length, pole_mass, polemass_length, tau = p[0], p[1], p[2], p[3], p[4], p[5]
    x, x_dot, theta, theta_dot = state[0], state[1], state[2], state[3]
    cos, sin = math.cos(theta), math.sin(theta)

    temp = np.divide(control[0] + polemass_length * (theta_dot * theta_dot) * sin, total_mass)
    inertia = length * (4.0 / 3.0 - np.divide(pole_mass * (cos * cos), total_mass))
    theta_acc = np.divide(gravity * sin - cos * temp, inertia)
    x_acc = temp - np.divide(polemass_length * theta_acc * cos, total_mass)

    if p[8]:  # euler
        x = x + tau * x_dot
        x_dot = x_dot + tau * x_acc
        theta = theta + tau * theta_dot
        theta_dot = theta_dot + tau * theta_acc
    else:  # semi-implicit euler
        x_dot = x_dot + tau * x_acc
        x = x + tau * x_dot
        theta_dot = theta_dot + tau * theta_acc
        theta = theta + tau * theta_dot

    state[0], state[1], state[2], state[3] = x, x_dot, theta, theta_dot
    for i in range(4):
        observation[i] = state[i]
    fallen = x < -p[6] or x > p[6] or theta < -p[7] or theta > p[7]
    if p[9]:  # Sutton and Barto's reward
        return (-1.0 if fallen else 0.0), fallen
    return 1.0, fallen
