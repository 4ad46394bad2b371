"""Acrobot: the arithmetic of gymnasium.envs.classic_control.acrobot (the book's equations), operation for operation."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from trainables.numerics.jit import compiled

GRAVITY = 9.8

F64 = NDArray[np.float64]


def parameters(env: Any) -> list[float]:
    """Return the parameters of `step`. Raises ValueError for equations or noise that it does not support."""
    if env.book_or_nips != "book" or env.torque_noise_max > 0:
        raise ValueError("only the book's equations without noise are compiled")
    m1, m2, l1 = env.LINK_MASS_1, env.LINK_MASS_2, env.LINK_LENGTH_1
    lc1, lc2, moi = env.LINK_COM_POS_1, env.LINK_COM_POS_2, env.LINK_MOI
    return [
        env.dt,
        env.MAX_VEL_1,
        env.MAX_VEL_2,
        m2,
        moi,
        m1 * lc1**2,
        l1**2 + lc2**2,
        2 * l1 * lc2,
        lc2**2,
        l1 * lc2,
        m2 * lc2 * GRAVITY,
        -m2 * l1 * lc2,
        2 * m2 * l1 * lc2,
        (m1 * lc1 + m2 * l1) * GRAVITY,
        m2 * l1 * lc2,
        m2 * lc2**2 + moi,
        2.0,
    ]


def control(env: Any, action: Any) -> list[float]:
    """Return the torque of an action."""
    return [env.AVAIL_TORQUE[action]]


@compiled
def _derivative(
    p: F64, torque: float, theta1: float, theta2: float, dtheta1: float, dtheta2: float
) -> tuple[float, float, float, float]:
    m2, moi, two = p[3], p[4], p[16]  # a power of a constant would become a product, with different rounding
    cos2, sin2 = math.cos(theta2), math.sin(theta2)
    d1 = p[5] + m2 * (p[6] + p[7] * cos2) + moi + moi
    d2 = m2 * (p[8] + p[9] * cos2) + moi
    phi2 = p[10] * math.cos(theta1 + theta2 - math.pi / 2.0)
    phi1 = (
        p[11] * dtheta2**two * sin2 - p[12] * dtheta2 * dtheta1 * sin2 + p[13] * math.cos(theta1 - math.pi / 2.0) + phi2
    )
    push = torque + np.divide(d2, d1) * phi1 - p[14] * dtheta1**two * sin2 - phi2
    ddtheta2 = np.divide(push, p[15] - np.divide(d2**two, d1))
    ddtheta1 = np.divide(-(d2 * ddtheta2 + phi1), d1)
    return dtheta1, dtheta2, ddtheta1, ddtheta2


@compiled
def _wrap(x: float) -> float:
    """Return the angle in [-pi, pi]."""
    while x > math.pi:
        x = x - 2 * math.pi
    while x < -math.pi:
        x = x + 2 * math.pi
    return x


@compiled
def _bound(x: float, most: float) -> float:
    low = -most if -most > x else x
    return most if most < low else low


@compiled
def step(p: F64, control: F64, state: F64, observation: NDArray[np.float32]) -> tuple[float, bool]:
    """Step `state` (theta1, theta2, their velocities) and `observation` (6,) in place; return (reward, terminated)."""
    dt, torque = p[0], control[0]
    half = dt / 2.0
    a, b, c, d = state[0], state[1], state[2], state[3]
    k1 = _derivative(p, torque, a, b, c, d)
    k2 = _derivative(p, torque, a + half * k1[0], b + half * k1[1], c + half * k1[2], d + half * k1[3])
    k3 = _derivative(p, torque, a + half * k2[0], b + half * k2[1], c + half * k2[2], d + half * k2[3])
    k4 = _derivative(p, torque, a + dt * k3[0], b + dt * k3[1], c + dt * k3[2], d + dt * k3[3])
    share = dt / 6.0
    for i in range(4):
        state[i] = state[i] + share * (k1[i] + 2 * k2[i] + 2 * k3[i] + k4[i])
    theta1, theta2 = _wrap(state[0]), _wrap(state[1])
    state[0], state[1] = theta1, theta2
    state[2], state[3] = _bound(state[2], p[1]), _bound(state[3], p[2])

    cos1 = math.cos(theta1)
    observation[0], observation[1] = cos1, math.sin(theta1)
    observation[2], observation[3] = math.cos(theta2), math.sin(theta2)
    observation[4], observation[5] = state[2], state[3]
    up = -cos1 - math.cos(theta2 + theta1) > 1.0
    return (0.0 if up else -1.0), up
