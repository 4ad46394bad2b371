"""Context features: at their default nothing changes, changed they act, as an independently built environment does."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Callable
from typing import Any

import gymnasium
import numpy as np
import pytest

from trainables.errors import InputError
from trainables.tasks.builtin.reacher_env import TORQUES
from trainables.tasks.make import make_env
from trainables.tasks.registry import families, parse_task

GYM = {"cartpole": "CartPole-v1", "acrobot": "Acrobot-v1", "lunar_lander": "LunarLander-v3", "reacher": "Reacher-v5"}
CHANGED = {
    "cartpole": ["gravity=5x", "pole_length=2x", "pole_mass=2x", "cart_mass=2x"],
    "acrobot": ["link_mass=1.5", "link_length_1=1.2", "link_length_2=0.8"],
    "lunar_lander": ["mass=1.1", "gravity=-5", "wind_power=10", "turbulence_power=1"],
    "reacher": ["y_force=0.75", "gravity=-9.81", "damping=2x", "gear=0.5x", "control_cost=0"],
}


def rollout(env: gymnasium.Env, steps: int = 150, torques: bool = False) -> list[bytes]:
    """Bytes of every observation and reward under fixed actions."""
    seen = [env.reset(seed=5)[0].tobytes()]
    count = 9 if torques or not hasattr(env.action_space, "n") else int(env.action_space.n)
    for action in np.random.default_rng(1).integers(0, count, steps):
        given: Any = TORQUES[action] if torques else int(action)
        observation, reward, terminated, truncated, _ = env.step(given)
        seen.append(observation.tobytes() + np.float64(reward).tobytes())
        if terminated or truncated:
            seen.append(env.reset()[0].tobytes())
    return seen


@pytest.mark.parametrize("name", GYM)
def test_the_default_task_is_the_plain_environment_bit_for_bit(name: str) -> None:
    limit = {"max_episode_steps": 200} if name == "cartpole" else {}
    plain = gymnasium.make(GYM[name], **limit)
    assert rollout(make_env(parse_task(name))) == rollout(plain, torques=name == "reacher")


@pytest.mark.parametrize(("name", "change"), [(name, change) for name in CHANGED for change in CHANGED[name]])
def test_a_changed_feature_changes_the_next_states(name: str, change: str) -> None:
    default, changed = rollout(make_env(parse_task(name)), 40), rollout(make_env(parse_task(f"{name}:{change}")), 40)
    assert default[-1] != changed[-1]


@pytest.mark.parametrize("name", GYM)
def test_every_feature_is_either_tested_for_its_effect_or_the_time_limit(name: str) -> None:
    tested = {change.split("=")[0] for change in CHANGED[name]}
    assert tested | {"limit"} == {feature.name for feature in families()[name].features}


@pytest.mark.parametrize("name", GYM)
def test_the_limit_truncates(name: str) -> None:
    env = make_env(parse_task(f"{name}:limit=3"))
    env.reset(seed=0)
    assert [env.step(0)[3] for _ in range(3)] == [False, False, True]


def heavy_cartpole() -> gymnasium.Env:
    env = gymnasium.make("CartPole-v1", max_episode_steps=200)
    env.unwrapped.gravity = 49.0
    return env


def heavy_acrobot() -> gymnasium.Env:
    from gymnasium.envs.classic_control.acrobot import AcrobotEnv

    class Heavy(AcrobotEnv):
        LINK_MASS_1 = LINK_MASS_2 = 2.0

    return gymnasium.wrappers.TimeLimit(Heavy(), 500)


def heavy_lander() -> gymnasium.Env:
    """The environment's own source text with another density in it."""
    import inspect

    from gymnasium.envs.box2d import lunar_lander

    source = inspect.getsource(lunar_lander)
    assert source.count("density=5.0") == 1
    module: dict[str, Any] = {"__name__": "heavy"}
    exec(source.replace("density=5.0", "density=7.5"), module)
    return gymnasium.wrappers.TimeLimit(module["LunarLander"](), 1000)


def windy_lander() -> gymnasium.Env:
    return gymnasium.make("LunarLander-v3", enable_wind=True, wind_power=12.0, turbulence_power=1.2, gravity=-6.0)


def pushed_reacher() -> gymnasium.Env:
    env = gymnasium.make("Reacher-v5")

    class Pushed(gymnasium.Wrapper):  # type: ignore[type-arg]
        def step(self, action: Any) -> Any:
            data, model = self.unwrapped.data, self.unwrapped.model
            data.xfrc_applied[model.body("fingertip").id] = (0, 0.75, 0, 0, 0, 0)
            return super().step(action)

    return Pushed(env)


def falling_reacher() -> gymnasium.Env:
    env = gymnasium.make("Reacher-v5", reward_control_weight=0.0)
    env.unwrapped.model.opt.gravity[1] = 0.75  # type: ignore[attr-defined]
    return env


@pytest.mark.parametrize(
    ("task", "build"),
    [
        ("cartpole:gravity=5x", heavy_cartpole),
        ("acrobot:link_mass=2", heavy_acrobot),
        ("lunar_lander:mass=1.5", heavy_lander),
        ("lunar_lander:gravity=-6,wind_power=12,turbulence_power=1.2", windy_lander),
        ("reacher:y_force=0.75", pushed_reacher),
        ("reacher:gravity=0.75,control_cost=0", falling_reacher),
    ],
)
def test_the_papers_targets_equal_an_independently_built_environment(
    task: str, build: Callable[[], gymnasium.Env]
) -> None:
    assert rollout(make_env(parse_task(task)), 2000) == rollout(build(), 2000, torques=task.startswith("reacher"))


def test_derived_fields_of_cartpole_follow() -> None:
    env = make_env(parse_task("cartpole:pole_mass=3x,cart_mass=2,pole_length=2x")).unwrapped
    assert env.total_mass == env.masspole + env.masscart == pytest.approx(2.3)
    assert env.polemass_length == env.masspole * env.length == pytest.approx(0.3)


@pytest.mark.parametrize("name", CHANGED)
def test_a_changed_environment_leaves_the_next_plain_one_alone(name: str) -> None:
    before = rollout(make_env(parse_task(name)), 40)
    for change in CHANGED[name]:
        rollout(make_env(parse_task(f"{name}:{change}")), 5)
    assert rollout(make_env(parse_task(name)), 40) == before


@pytest.mark.parametrize("family", GYM)
def test_the_papers_targets_are_named(family: str) -> None:
    for target in families()[family].targets:
        assert parse_task(target).name.startswith(f"{family}:")


def test_the_registry_imports_no_simulator_and_no_torch() -> None:
    heavy = "torch", "gymnasium", "mujoco", "Box2D"
    code = f"import sys, trainables.tasks.registry as t; t.families(); print([m for m in {heavy} if m in sys.modules])"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"


def test_any_gymnasium_environment_with_discrete_actions_is_a_task() -> None:
    task = parse_task("gym:MountainCar-v0:gravity=2x")
    assert make_env(task).unwrapped.gravity == 0.005
    assert parse_task(task.name) == task
    assert task.name == "gym:MountainCar-v0:gravity=0.005"


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("gym:MountainCar-v0:gravty=2x", "gravty is not an attribute"),
        ("gym:MountainCar-v0:no.such.path=2x", "no.such.path is not an attribute"),
        ("gym:CartPole-v1:kinematics_integrator=2", "not a number"),
        ("gym:Ant-v5", "levels=3 in 8 dimensions are 6561 actions, more than 1024: levels=2 are 256"),
        ("gym:Humanoid-v5", "129140163 actions, more than 1024: there are too many dimensions"),
        ("gym:Pendulum-v1:levels=1", "levels must be a number between 2 and 1024"),
        ("gym:Pendulum-v1:levels=2.5", "levels must be a whole number"),
        ("gym:CartPole-v1:levels=5", "levels is not an attribute"),
        ("gym:CartPol-v1", "did you mean 'CartPole-v1'"),
        ("gym:no_such_module:Thing-v0", "no module 'no_such_module'"),
        ("gym:", "write gym:ENVIRONMENT-ID"),
        ("cartpole:gravity=-1", "gravity must be a number between 0"),
        ("lunar_lander:wind=3", "unknown context feature"),
    ],
)
def test_bad_tasks_are_refused_with_one_sentence(text: str, says: str) -> None:
    with pytest.raises(InputError, match=says) as caught:
        parse_task(text)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("text", ["gym:MountainCar-v0:goal_position=0.4", "gym:CartPole-v1:screen_width=2x"])
def test_a_feature_that_random_actions_cannot_show_is_warned_of_and_taken(
    text: str, caplog: pytest.LogCaptureFixture
) -> None:
    gym_task_check = parse_task(text).family.check
    caplog.clear()
    gym_task_check(parse_task(text).context)
    assert "changes nothing in 100 random steps" in caplog.text


def test_an_environment_that_cannot_be_made_is_refused_in_a_sentence(monkeypatch: pytest.MonkeyPatch) -> None:
    def broken() -> None:
        raise RuntimeError("no licence\nfor this simulator")

    gymnasium.register("Broken-v0", entry_point=broken)
    try:
        with pytest.raises(InputError, match="task 'gym:Broken-v0': no licence for this simulator"):
            parse_task("gym:Broken-v0")
    finally:
        del gymnasium.registry["Broken-v0"]
