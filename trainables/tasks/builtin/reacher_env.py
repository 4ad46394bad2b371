"""Reacher with nine discrete actions; imports MuJoCo, so only a task that is built imports this."""

from __future__ import annotations

from typing import Any

import numpy as np
from gymnasium.envs.mujoco.reacher_v5 import ReacherEnv
from gymnasium.spaces import Box, Discrete

from trainables.tasks.wrappers.discretise import action_table

TORQUES = action_table(Box(-1.0, 1.0, (2,), np.float32), 3)
"""(9, 2): the torques of both joints for each action; 4 is none at all."""


class DiscreteReacher(ReacherEnv):
    """Reacher whose action is a row of TORQUES, with a constant force on the fingertip along y."""

    def __init__(self, y_force: float = 0.0) -> None:
        super().__init__()
        self.action_space = Discrete(len(TORQUES))
        self._y_force = y_force
        self._fingertip = self.model.body("fingertip").id

    def step(self, action: Any) -> tuple[Any, Any, bool, bool, dict[str, Any]]:
        """One step with the torques of `action`."""
        step: Any = super().step
        result: tuple[Any, Any, bool, bool, dict[str, Any]] = step(TORQUES[action])
        return result

    def reset_model(self) -> Any:
        """The first observation; a reset clears every force, so the fingertip's is set again."""
        reset: Any = super().reset_model
        observation = reset()
        if self._y_force:
            self.data.xfrc_applied[self._fingertip, 1] = self._y_force
        return observation
