"""The environments with a compiled simulator, and the check on this machine that the two agree."""

from __future__ import annotations

from typing import Any, NamedTuple

import gymnasium
import numpy as np
from gymnasium.envs import classic_control

from trainables.tasks.simulators import acrobot, cartpole, mountain_car, pendulum
from trainables.tasks.simulators.simulator import ACROBOT, CARTPOLE, MOUNTAIN_CAR, PENDULUM, Simulator, step
from trainables.tasks.wrappers.discretise import Discretised

_PHYSICS: dict[type, tuple[int, Any]] = {
    classic_control.CartPoleEnv: (CARTPOLE, cartpole),
    classic_control.AcrobotEnv: (ACROBOT, acrobot),
    classic_control.MountainCarEnv: (MOUNTAIN_CAR, mountain_car),
    classic_control.PendulumEnv: (PENDULUM, pendulum),
}

STEPS = 200
"""Steps over which an environment and its simulator must agree before the simulator is used."""

_PROVEN: dict[tuple[int, bytes, bytes], Simulator | None] = {}


def simulator_of(env: gymnasium.Env[Any, Any], first: int, actions: int) -> Simulator | None:
    """Return the simulator of an environment without wrappers, whose actions are first, first + 1, ...; or None.

    None also where the two do not agree bit for bit here: another release of Gymnasium may compute something else, and
    on some processors numpy's sine differs from the C library's.
    """
    inner = env.env if isinstance(env, Discretised) else env
    kind, physics = _PHYSICS.get(type(inner), (-1, None))
    if physics is None or {"step", "reset"} & vars(inner).keys():
        return None
    try:
        given = range(first, first + actions) if inner is env else env.table  # type: ignore[attr-defined]
        parameters = np.array(physics.parameters(inner), np.float64)
        controls = np.array([physics.control(inner, action) for action in given], np.float64)
    except (ArithmeticError, LookupError, TypeError, ValueError):
        return None
    key = kind, parameters.tobytes(), controls.tobytes()
    if key not in _PROVEN:
        simulator = Simulator(kind, parameters, controls)
        with np.errstate(all="ignore"):
            _PROVEN[key] = simulator if differs(env, simulator, STEPS, first) is None else None
    return _PROVEN[key]


class Difference(NamedTuple):
    """The first step at which an environment and its simulator differ."""

    step: int
    environment: tuple[Any, ...]
    simulator: tuple[Any, ...]


def differs(
    env: gymnasium.Env[Any, Any], simulator: Simulator, steps: int, first: int = 0, seed: int = 0
) -> Difference | None:
    """Return where `env` and `simulator` differ in so many steps of random actions, bit for bit, or None."""
    rng = np.random.default_rng(seed)
    inner: Any = env.unwrapped
    seen, state = start(env, seed)
    observation = np.array(seen, np.float32)
    for number, action in enumerate(rng.integers(len(simulator.controls), size=steps).tolist()):
        seen, reward, terminated, _, _ = env.step(first + action)
        got, ended = step(simulator.kind, simulator.parameters, simulator.controls[action], state, observation)
        theirs = _bits(seen, reward, inner.state), bool(terminated)
        ours = _bits(observation, got, state), bool(ended)
        if theirs != ours:
            return Difference(number, (seen, reward, terminated, inner.state), (observation, got, ended, state))
        if terminated or (number % 199 == 198):
            seen, state = start(env, int(rng.integers(2**31)))
            observation[:] = seen
    return None


def _bits(observation: Any, reward: Any, state: Any) -> bytes:
    numbers = np.asarray(observation, np.float32), np.float64(reward), np.array(state, np.float64)
    return b"".join(part.tobytes() for part in numbers)


def start(env: gymnasium.Env[Any, Any], seed: int) -> tuple[Any, Any]:
    """Return (observation, state (k,)) of a new episode, from the environment's reset."""
    inner: Any = env.unwrapped
    observation, _ = env.reset(seed=seed)
    return observation, np.array(inner.state, np.float64)
