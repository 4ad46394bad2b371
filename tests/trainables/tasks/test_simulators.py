"""Compiled simulators equal Gymnasium bit for bit, with every context feature, and stand aside where they do not."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium.envs.classic_control import CartPoleEnv

from trainables.learners.greedy_evaluation import greedy_returns
from trainables.tasks.make import make_env
from trainables.tasks.registry import families, parse_task
from trainables.tasks.simulators import registry
from trainables.tasks.simulators.registry import differs, simulator_of
from trainables.tasks.step_env import Environment
from trainables.tasks.wrappers.unwrap import unwrap

PLAIN = ["cartpole", "acrobot", "gym:MountainCar-v0", "gym:Pendulum-v1"]
CHANGED = [
    "cartpole:gravity=5x",
    "cartpole:gravity=7x",
    "cartpole:pole_length=2x",
    "cartpole:pole_mass=2x",
    "cartpole:cart_mass=2x",
    "acrobot:link_mass=1.5",
    "acrobot:link_mass=2",
    "acrobot:link_length_1=1.2",
    "acrobot:link_length_2=0.8",
    "gym:CartPole-v1:force_mag=2x,tau=0.03,theta_threshold_radians=0.5x",
    "gym:Acrobot-v1:MAX_VEL_1=0.5,dt=0.1,LINK_MOI=2",
    "gym:MountainCar-v0:gravity=2x",
    "gym:MountainCar-v0:max_speed=0.01",
    "gym:MountainCar-v0:force=3x",
    "gym:MountainCar-v0:max_position=-0.48",
    "gym:Pendulum-v1:g=2x,levels=5",
    "gym:Pendulum-v1:max_speed=2,levels=2",
    "gym:Pendulum-v1:m=0.7,l=1.5,dt=0.1",
    "gym:Pendulum-v1:max_torque=1",
]


def simulated(task: str) -> tuple[Any, Any]:
    """The environment without its wrappers, and its simulator."""
    env, _ = unwrap(make_env(parse_task(task)))
    return env, simulator_of(env, 0, int(env.action_space.n))  # type: ignore[attr-defined]


@pytest.mark.parametrize("task", [*PLAIN, *CHANGED])
def test_a_simulator_is_the_environment_bit_for_bit(task: str) -> None:
    env, simulator = simulated(task)
    assert simulator is not None
    assert differs(env, simulator, 5000, seed=1) is None


@pytest.mark.slow
@pytest.mark.parametrize("task", PLAIN)
def test_a_million_steps_are_equal_bit_for_bit(task: str) -> None:
    env, simulator = simulated(task)
    assert differs(env, simulator, 10**6, seed=2) is None


@pytest.mark.parametrize("name", ["cartpole", "acrobot"])
def test_every_context_feature_is_among_the_tested(name: str) -> None:
    tested = {task.split(":")[1].split("=")[0] for task in CHANGED if task.startswith(name)}
    assert tested | {"limit"} == {feature.name for feature in families()[name].features}


def test_an_episode_ends_at_mountain_cars_goal() -> None:
    env: Any = gymnasium.make("MountainCar-v0").unwrapped
    env.goal_position, env.goal_velocity = -0.45, 0.001
    assert differs(env, simulator_of(env, 0, 3), 5000) is None
    env.reset(seed=0)
    assert any(env.step(2)[2] for _ in range(200))


def test_semi_implicit_steps_and_suttons_reward() -> None:
    env: Any = CartPoleEnv(sutton_barto_reward=True)
    env.kinematics_integrator = "semi-implicit"
    simulator = simulator_of(env, 0, 2)
    assert simulator is not None
    assert differs(env, simulator, 2000) is None


def test_actions_that_begin_elsewhere_are_the_environments() -> None:
    env: Any = gymnasium.make("MountainCar-v0").unwrapped
    env.action_space = gymnasium.spaces.Discrete(3, start=1)
    simulator = simulator_of(env, 1, 3)
    assert simulator is not None
    assert differs(env, simulator, 500, first=1) is None


class Windy(CartPoleEnv):
    """A subclass, which may compute anything."""


def _noisy() -> gymnasium.Env[Any, Any]:
    return unwrap(make_env(parse_task("gym:Acrobot-v1:torque_noise_max=0.5")))[0]


def _patched() -> gymnasium.Env[Any, Any]:
    env = CartPoleEnv()
    env.step = lambda action: CartPoleEnv.step(env, action)  # type: ignore[method-assign]
    return env


def _other() -> gymnasium.Env[Any, Any]:
    return unwrap(make_env(parse_task("lunar_lander")))[0]


@pytest.mark.parametrize("build", [Windy, _noisy, _patched, _other])
def test_what_is_not_known_is_not_simulated(build: Any) -> None:
    env = build()
    assert simulator_of(env, 0, int(env.action_space.n)) is None
    assert Environment(env).simulator is None


def test_a_simulator_that_differs_is_found_out_and_not_used(monkeypatch: pytest.MonkeyPatch) -> None:
    env, simulator = simulated("cartpole")
    wrong = simulator.parameters.copy()
    wrong[0] = np.nextafter(wrong[0], 10)
    found = differs(env, replace(simulator, parameters=wrong), 5000)
    assert found is not None
    monkeypatch.setattr(registry, "_PROVEN", {})
    monkeypatch.setattr(registry, "differs", lambda *given: found)
    assert Environment(env).simulator is None


@pytest.mark.parametrize("task", [*PLAIN, "cartpole:limit=7"])
def test_steps_returns_and_limits_are_those_of_the_plain_environment(task: str) -> None:
    fast, plain = (Environment(make_env(parse_task(task)), simulated=given) for given in (True, False))
    assert fast.simulator is not None
    assert plain.simulator is None
    rng = np.random.default_rng(0)
    for seed in range(3):
        assert fast.reset(seed).tobytes() == plain.reset(seed).tobytes()
        done = False
        while not done:
            action = int(rng.integers(fast.actions))
            (seen, *ours), (expected, *theirs) = fast.step(action), plain.step(action)
            assert (seen.tobytes(), ours) == (expected.tobytes(), theirs)
            done = ours[1] or ours[2]


@pytest.mark.parametrize("task", ["cartpole", "acrobot:limit=80", "gym:Pendulum-v1"])
def test_greedy_returns_are_equal_bit_for_bit(task: str) -> None:
    groups = [[Environment(make_env(parse_task(task)), simulated=given) for _ in range(12)] for given in (True, False)]
    inputs, actions = groups[0][0].inputs, groups[0][0].actions
    weights = np.random.default_rng(3).standard_normal((inputs, actions)).astype(np.float32)
    ours, theirs = (greedy_returns(group, range(12), lambda x: x @ weights, 0.97) for group in groups)
    assert [values.tobytes() for values in ours] == [values.tobytes() for values in theirs]
