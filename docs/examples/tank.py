"""A custom task, complete: `deltatune check tank.py:Task`."""

import gymnasium
import numpy as np
from gymnasium.spaces import Box, Discrete

from deltatune import feature, task


class Tank(gymnasium.Env):
    """Hold the level of a leaking tank at one half with a slow pump that is off, half on or on."""

    def __init__(self, leak=0.05, pump=0.1):
        self.leak, self.pump = leak, pump
        self.observation_space = Box(0, 1, (2,), np.float32)
        self.action_space = Discrete(3)

    def reset(self, *, seed=None, options=None):
        super().reset(seed=seed)
        self.level, self.flow = self.np_random.uniform(0, 1), 0.0
        return np.array([self.level, self.flow], np.float32), {}

    def step(self, action):
        self.flow += 0.3 * (self.pump * action / 2 - self.flow)
        self.level = min(max(self.level + self.flow - self.leak * self.level**0.5, 0.0), 1.0)
        return np.array([self.level, self.flow], np.float32), -abs(self.level - 0.5), False, False, {}


Task = task(
    Tank,
    feature("leak", 0.05, 0, 0.2, "outflow of a full tank in one step"),
    feature("pump", 0.1, 0, 1, "inflow at full power in one step"),
    limit=60,
    targets=("leak=1.5x", "pump=0.5x"),
    episodes=200,
    hidden_size=32,
)
