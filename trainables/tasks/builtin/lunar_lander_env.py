"""LunarLander with another mass; imports Box2D, so it is imported only when the task is built."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from gymnasium.envs.box2d.lunar_lander import (
    FPS,
    LEG_DOWN,
    MAIN_ENGINE_POWER,
    MAIN_ENGINE_Y_LOCATION,
    SCALE,
    SIDE_ENGINE_AWAY,
    SIDE_ENGINE_HEIGHT,
    SIDE_ENGINE_POWER,
    VIEWPORT_H,
    VIEWPORT_W,
    LunarLander,
)

HALF_WIDTH, HALF_HEIGHT = VIEWPORT_W / SCALE / 2, VIEWPORT_H / SCALE / 2
SIDE_ENGINE_X = 17
"""The position of the side engines, for which Gymnasium's step has no constant."""


class HeavyLander(LunarLander):
    """LunarLander with `mass` times the density of the lander; the legs keep theirs.

    A step performs the operations of Gymnasium's, except those for drawing and checking, and gives the same bits.
    """

    prev_shaping: Any

    def __init__(self, mass: float = 1.0, **settings: Any) -> None:
        super().__init__(**settings)
        self._mass = mass
        self._weighed: Any = None

    def step(self, action: Any) -> tuple[Any, Any, bool, bool, dict[str, Any]]:
        """Take a step. `reset` builds a lander and takes a first step, where its mass is set before it moves."""
        lander: Any = self.lander
        if lander is not self._weighed:
            self._weighed = lander
            if self._mass != 1.0:
                _weigh(lander, self._mass)
        if self.enable_wind and not (self.legs[0].ground_contact or self.legs[1].ground_contact):
            self._blow(lander)
        self._fire(lander, action)
        self.world.Step(1.0 / FPS, 6 * 30, 2 * 30)
        state = self._look(lander)
        reward = self._reward(state) - (0.3 if action == 2 else 0.0)
        reward -= 0.03 if action in (1, 3) else 0.0
        if not lander.awake:
            return np.array(state, np.float32), 100.0, True, False, {}
        if self.game_over or abs(state[0]) >= 1.0:
            return np.array(state, np.float32), -100.0, True, False, {}
        return np.array(state, np.float32), reward, False, False, {}

    def _blow(self, lander: Any) -> None:
        """Apply the wind's force and torque: the maximum times tanh(sin(2 k x) + sin(pi k x))."""
        lander.ApplyForceToCenter((_gust(int(self.wind_idx)) * self.wind_power, 0.0), True)
        lander.ApplyTorque(_gust(int(self.torque_idx)) * self.turbulence_power, True)
        self.wind_idx += 1
        self.torque_idx += 1

    def _fire(self, lander: Any, action: int) -> None:
        """Apply the engine's impulse; its noise is drawn for every action."""
        draw = self.np_random.random  # uniform(-1, 1) is -1 + 2 random(), without a rounding error
        noise = (-1.0 + 2.0 * draw()) / SCALE, (-1.0 + 2.0 * draw()) / SCALE
        if action == 0:
            return
        angle, at = lander.angle, lander.position
        tip = math.sin(angle), math.cos(angle)
        side = -tip[1], tip[0]
        if action == 2:
            reach, power = MAIN_ENGINE_Y_LOCATION / SCALE + 2 * noise[0], MAIN_ENGINE_POWER
            ox = tip[0] * reach + side[0] * noise[1]
            oy = -tip[1] * reach - side[1] * noise[1]
            place = at.x + ox, at.y + oy
        else:
            reach, power = 3 * noise[1] + (action - 2) * SIDE_ENGINE_AWAY / SCALE, SIDE_ENGINE_POWER
            ox = tip[0] * noise[0] + side[0] * reach
            oy = -tip[1] * noise[0] - side[1] * reach
            place = at.x + ox - tip[0] * SIDE_ENGINE_X / SCALE, at.y + oy + tip[1] * SIDE_ENGINE_HEIGHT / SCALE
        lander.ApplyLinearImpulse((-ox * power, -oy * power), place, True)

    def _look(self, lander: Any) -> list[float]:
        at, velocity = lander.position, lander.linearVelocity
        return [
            (at.x - HALF_WIDTH) / HALF_WIDTH,
            (at.y - (self.helipad_y + LEG_DOWN / SCALE)) / HALF_HEIGHT,
            velocity.x * HALF_WIDTH / FPS,
            velocity.y * HALF_HEIGHT / FPS,
            lander.angle,
            20.0 * lander.angularVelocity / FPS,
            1.0 if self.legs[0].ground_contact else 0.0,
            1.0 if self.legs[1].ground_contact else 0.0,
        ]

    def _reward(self, s: list[float]) -> float:
        """Return the shaped reward: how much nearer, slower and more upright the lander is than a step ago."""
        shaping = (
            -100 * math.sqrt(s[0] * s[0] + s[1] * s[1])
            - 100 * math.sqrt(s[2] * s[2] + s[3] * s[3])
            - 100 * abs(s[4])
            + 10 * s[6]
            + 10 * s[7]
        )
        before, self.prev_shaping = self.prev_shaping, shaping
        return 0.0 if before is None else shaping - before


def _gust(number: int) -> float:
    return math.tanh(math.sin(0.02 * number) + math.sin(math.pi * 0.01 * number))


def _weigh(lander: Any, factor: float) -> None:
    for fixture in lander.fixtures:
        fixture.density *= factor
    lander.ResetMassData()
