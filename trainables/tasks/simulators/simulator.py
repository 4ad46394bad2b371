"""The data of a compiled simulator, and the step function of all of them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from trainables.numerics.jit import compiled
from trainables.tasks.simulators import acrobot, cartpole, mountain_car, pendulum

F32 = NDArray[np.float32]
F64 = NDArray[np.float64]
I64 = NDArray[np.int64]

CARTPOLE, ACROBOT, MOUNTAIN_CAR, PENDULUM = range(4)


@dataclass(frozen=True, eq=False)
class Simulator:
    """The physics of one environment as numbers, for `step`."""

    kind: int
    """The step function: CARTPOLE, ACROBOT, MOUNTAIN_CAR or PENDULUM."""
    parameters: F64
    """The environment's physics, in the order of its step function."""
    controls: F64
    """(actions, k): the effect of each action, e.g. a force."""

    @property
    def physics(self) -> tuple[int, F64, F64]:
        """(kind, parameters, controls)."""
        return self.kind, self.parameters, self.controls


@compiled
def step(kind: int, parameters: F64, control: F64, state: F64, observation: F32) -> tuple[float, bool]:
    """Advance `state` by one step under `control` (k,), fill `observation`, and return (reward, terminated)."""
    if kind == CARTPOLE:
        return cartpole.step(parameters, control, state, observation)
    if kind == ACROBOT:
        return acrobot.step(parameters, control, state, observation)
    if kind == MOUNTAIN_CAR:
        return mountain_car.step(parameters, control, state, observation)
    return pendulum.step(parameters, control, state, observation)


@compiled
def step_all(
    kind: int,
    parameters: F64,
    controls: F64,
    actions: I64,
    running: I64,
    states: F64,
    observations: F32,
    total: F64,
    discounted: F64,
    discount: float,
) -> int:
    """Take a step in each episode of `running`, with the action at the same index of `actions`.

    Add the rewards to `total` and `discounted`, move the indices of episodes that have not terminated to the front of
    `running`, and return their number.
    """
    left = 0
    for place in range(len(actions)):
        i = running[place]
        reward, terminated = step(kind, parameters, controls[actions[place]], states[i], observations[i])
        total[i] += reward
        discounted[i] += discount * reward
        if not terminated:
            running[left] = i
            left += 1
    return left
