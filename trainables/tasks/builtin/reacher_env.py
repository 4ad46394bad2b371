"""Reacher with nine discrete actions; imports MuJoCo, so it is imported only when the task is built."""

from __future__ import annotations

import math
from typing import Any

import mujoco
import numpy as np
from gymnasium.envs.mujoco.reacher_v5 import ReacherEnv
from gymnasium.spaces import Box, Discrete
from numpy.typing import NDArray

from trainables.tasks.wrappers.discretise import action_table

TORQUES = action_table(Box(-1.0, 1.0, (2,), np.float32), 3)
"""(9, 2): the torques of both joints for each action; action 4 is no torque."""


class DiscreteReacher(ReacherEnv):
    """Reacher whose action is a row of TORQUES, with a constant force on the fingertip along y.

    A step calls MuJoCo once, and reads Gymnasium's observation and reward from MuJoCo's memory.
    """

    def __init__(self, y_force: float = 0.0, control_cost: float = 1.0) -> None:
        super().__init__(reward_control_weight=control_cost)
        self.action_space = Discrete(len(TORQUES))
        self._y_force = y_force
        self._fingertip = self.model.body("fingertip").id
        data = self.data
        self._views = data.ctrl, data.qpos, data.qvel, data.xpos[self._fingertip], data.body("target").xpos
        self._effort = [-float(np.square(torques).sum() * self._reward_control_weight) for torques in TORQUES]

    def step(self, action: Any) -> tuple[Any, Any, bool, bool, dict[str, Any]]:
        """Take a step with the torques of `action`."""
        control, positions, velocities, fingertip, target = self._views
        control[:] = TORQUES[action]
        mujoco.mj_step(self.model, self.data, self.frame_skip)
        apart: NDArray[np.float64] = fingertip - target
        observation = np.empty(10)
        np.cos(positions[:2], out=observation[:2])
        np.sin(positions[:2], out=observation[2:4])
        observation[4:6] = positions[2:]
        observation[6:8] = velocities[:2]
        observation[8:] = apart[:2]
        reward = -math.sqrt(apart.dot(apart)) * self._reward_dist_weight + self._effort[action]
        return observation, reward, False, False, {}

    def reset_model(self) -> Any:
        """Return the first observation; a reset clears all forces, so that on the fingertip is set again."""
        reset: Any = super().reset_model
        observation = reset()
        if self._y_force:
            self.data.xfrc_applied[self._fingertip, 1] = self._y_force
        return observation
