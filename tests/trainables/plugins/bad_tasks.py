"""Custom tasks that each break one promise, and one that keeps them all."""

import gymnasium
import numpy as np
from gymnasium.spaces import Box, Discrete, MultiDiscrete, Sequence

from trainables.agents.hyperparameters import QLearning
from trainables.custom import agent, feature, task
from trainables.learners.step_learner import StepLearner


class Walk(gymnasium.Env):
    """Walk to the right."""

    observation_space, action_space = Box(-9, 9, (2,), np.float32), Discrete(2)
    reward = 1.0

    def __init__(self, wind=0.0, idle=1.0):
        self.wind = wind

    def reset(self, *, seed=None, options=None):
        super().reset(seed=seed)
        self.x = 0.0
        return np.zeros(2, np.float32), {}

    def step(self, action):
        self.x += action - 0.5 + self.wind
        return np.array([self.x, 0], np.float32), self.reward, abs(self.x) > 5, False, {}


class RaisesInReset(Walk):
    """Its reset raises."""

    def reset(self, *, seed=None, options=None):
        raise RuntimeError("the simulator is not there")


class ChangesShape(Walk):
    """Its steps return more than its space says."""

    def step(self, action):
        observation, *rest = super().step(action)
        return np.append(observation, 0), *rest


class NanReward(Walk):
    """Its rewards are NaN."""

    def step(self, action):
        observation, _, *rest = super().step(action)
        return observation, np.log(-1.0 - 0 * self.x), *rest


class ManyActions(Walk):
    """Two actions at a time."""

    action_space = MultiDiscrete([2, 2])


class Continuous(Walk):
    """A force between -1 and 1, which is no fault where levels are declared."""

    action_space = Box(-1, 1, (1,), np.float32)

    def step(self, action):
        return super().step(float(action[0]))


class Talks(Walk):
    """Observations of any length."""

    observation_space = Sequence(Discrete(3))


class Late(Walk):
    """Breaks once it has been reset for a hundred times."""

    resets = 0

    def reset(self, *, seed=None, options=None):
        type(self).resets += 1
        return super().reset(seed=seed, options=options)


class RaisesLate(Late):
    """Its reset raises late."""

    def reset(self, *, seed=None, options=None):
        if self.resets > 100:
            raise RuntimeError("out of licences")
        return super().reset(seed=seed, options=options)


class NanLate(Late):
    """Its rewards are NaN late."""

    def step(self, action):
        observation, reward, *rest = super().step(action)
        return observation, np.nan if self.resets > 100 else reward, *rest


def made(env, **more):
    return task(env, feature("wind", 0.0, -1, 1), feature("idle", 1.0, 0, 9), limit=20, episodes=10, **more)


Good, Reset, Shape, Nan = made(Walk), made(RaisesInReset), made(ChangesShape), made(NanReward)
Multi, Torque, Words = made(ManyActions), made(Continuous), made(Talks)
Cut = task(Continuous, feature("wind", 0.0, -1, 1), limit=20, levels=3, episodes=10)
Endless = task(Walk, feature("wind", 0.0, -1, 1))
LateRaise, LateNan = (task(env, feature("wind", 0.0, -1, 1), limit=20, episodes=10) for env in (RaisesLate, NanLate))
Learner = agent(StepLearner, QLearning)
NotATask = 3
