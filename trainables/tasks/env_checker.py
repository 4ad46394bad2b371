"""The checks of `deltatune check`: determinism, defaults equal to the plain environment, effective features."""

from __future__ import annotations

import functools
import logging
import time
from collections.abc import Callable, Iterator
from contextlib import closing
from dataclasses import dataclass
from typing import Any

import gymnasium
import numpy as np
from gymnasium.spaces import Box

from trainables.errors import InputError
from trainables.plugins.loader import describe_error
from trainables.tasks.make import make_env
from trainables.tasks.spec.family import ContextFeature, Task, Value

STEPS = 300
"""Steps of a rollout."""

log = logging.getLogger("deltatune.tasks")


@dataclass(frozen=True)
class Finding:
    """The result of one check of a task."""

    question: str
    passed: bool | None
    """None: the check does not apply."""
    answer: str


def check(task: Task) -> Iterator[Finding]:
    """Yield the findings on a task; only the first where it cannot be built and stepped."""
    first = _asked("builds and steps", lambda: _spaces(task))
    yield first
    if not first.passed:
        return
    yield _asked("the same seed gives the same rollout", lambda: _deterministic(task))
    yield _asked("observations and rewards", lambda: _numbers(task))
    if task.tabular:
        yield _asked("steps agree with the exact model", lambda: _model(task))
    else:
        yield _asked("the default is the plain environment, bit for bit", lambda: _plain(task))
    for feature in task.family.features:
        yield _asked(f"{feature.name} acts", functools.partial(_effect, task, feature))


def steps_per_second(task: Task, seconds: float = 0.5) -> float:
    """Return the environment's steps per second, resets included."""
    with closing(make_env(task)) as env:
        env.reset(seed=0)
        actions = _actions(env, np.random.default_rng(0), 1000)
        env.step(actions[0])  # a compiled step is compiled now
        env.reset()
        steps, started = 0, time.perf_counter()
        while (spent := time.perf_counter() - started) < seconds:
            _, _, terminated, truncated, _ = env.step(actions[steps % 1000])
            steps += 1
            if terminated or truncated:
                env.reset()
        return steps / spent


def rollout(env: gymnasium.Env[Any, Any], steps: int = STEPS) -> list[bytes]:
    """Return the bytes of every observation, reward and flag under fixed actions and a fixed seed, and close `env`."""
    with closing(env):
        seen = [np.asarray(env.reset(seed=7)[0]).tobytes()]
        for action in _actions(env, np.random.default_rng(1), steps):
            observation, reward, terminated, truncated, _ = env.step(action)
            seen.append(np.asarray(observation).tobytes() + np.array([reward, terminated, truncated], float).tobytes())
            if terminated or truncated:
                seen.append(np.asarray(env.reset()[0]).tobytes())
    return seen


def refused(question: str, error: Exception) -> Finding:
    """Return the finding for an `error` of a task's code, and log where it was raised."""
    log.info("the check '%s' raised an error", question, exc_info=error)
    return Finding(question, False, describe_error(error))


def _asked(question: str, ask: Callable[[], tuple[bool | None, str]]) -> Finding:
    try:
        return Finding(question, *ask())
    except Exception as error:
        return refused(question, error)


def _actions(env: gymnasium.Env[Any, Any], rng: np.random.Generator, count: int) -> list[int]:
    space: Any = env.action_space
    return [int(action) for action in int(space.start) + rng.integers(0, int(space.n), count)]


def _spaces(task: Task) -> tuple[bool, str]:
    from trainables.tasks.step_env import Environment

    env = make_env(task)
    rollout(env, 5)
    if task.tabular:
        states: Any = env.observation_space
        return True, f"{states.n} states, {env.action_space.n} actions"  # type: ignore[attr-defined]
    with closing(Environment(make_env(task))) as seen:
        return True, f"vectors of {seen.inputs}, {seen.actions} actions, {seen.time_limit} steps at most"


def _deterministic(task: Task) -> tuple[bool, str]:
    first, second = rollout(make_env(task)), rollout(make_env(task))
    if first == second:
        return True, f"{STEPS} steps, twice"
    return False, f"two environments differ at step {_parting(first, second)}: draw only from self.np_random"


def _numbers(task: Task) -> tuple[bool, str]:
    with closing(make_env(task)) as env:
        return _sound(env)


def _sound(env: gymnasium.Env[Any, Any]) -> tuple[bool, str]:
    """Return whether observations and rewards are finite and as the space says."""
    space = env.observation_space
    observation, _ = env.reset(seed=3)
    outside, rewards = "", []
    for step, action in enumerate(_actions(env, np.random.default_rng(2), STEPS)):
        observation, reward, terminated, truncated, _ = env.step(action)
        rewards.append(float(reward))
        dtype = np.asarray(observation).dtype
        if isinstance(space, Box) and (dtype != space.dtype or np.shape(observation) != space.shape):
            return False, f"at step {step} a {dtype} of shape {np.shape(observation)}, the space says {space}"
        if not np.isfinite(np.asarray(observation)).all() or not np.isfinite(rewards[-1]):
            return False, f"at step {step} {observation} with reward {reward}: not finite"
        if not outside and not space.contains(observation):
            outside = f"; at step {step} outside the space's bounds, which agents tolerate"
        if terminated or truncated:
            env.reset()
    return True, f"finite, rewards from {min(rewards):g} to {max(rewards):g}{outside}"


def _plain(task: Task) -> tuple[bool | None, str]:
    if task.family.plain is None:
        return None, "there is no plain environment to compare with"
    default, plain = rollout(make_env(Task(task.family))), rollout(task.family.plain())
    if default == plain:
        return True, f"{STEPS} steps"
    return (
        False,
        f"they differ at step {_parting(default, plain)}: are the features' defaults those of the environment?",
    )


def _model(task: Task) -> tuple[bool, str]:
    model = task.model()
    actions = model.rewards.shape[1]
    with closing(make_env(task)) as env:
        state, _ = env.reset(seed=5)
        for action in _actions(env, np.random.default_rng(3), 10 * STEPS):
            after, _, terminated, truncated, _ = env.step(action)
            row = model.transitions[[state * actions + action]].toarray()[0]
            if not row[after] > 0 or terminated != bool(model.terminal[after]):
                return False, f"state {after} follows state {state} and action {action}, which the model excludes"
            state = env.reset()[0] if terminated or truncated else after
    return True, f"{10 * STEPS} steps"


def _effect(task: Task, feature: ContextFeature) -> tuple[bool | None, str]:
    """Return whether some other value changes the exact model or a rollout.

    None for an attribute of a Gymnasium environment without effect under random actions, which may never get to where
    it matters.
    """
    default, tried = _behaviour(Task(task.family)), []
    for value in _others(feature):
        changed = Task(task.family, ((feature.name, value),))
        try:
            task.family.check(changed.context)
            differs = _behaviour(changed) != default
        except InputError:
            continue
        if differs:
            return True, f"with {changed.name.partition(f'{feature.name}=')[2]}, not {feature.text(feature.default)}"
        tried.append(feature.text(value))
    known = None if task.family.name.startswith("gym:") else False
    return known, f"it changes nothing in {STEPS} random steps (tried {', '.join(tried) or 'no other value'})"


def _behaviour(task: Task) -> Any:
    if not task.tabular:
        env = make_env(task)
        actions: Any = env.action_space
        return int(actions.n), rollout(env)
    model = task.model()
    arrays = (model.rewards, model.transitions.data, model.transitions.indices, model.transitions.indptr)
    return model.start, model.time_limit, [array.tobytes() for array in arrays]


def _others(feature: ContextFeature) -> Iterator[Value]:
    """Yield values other than the default, small changes first."""
    texts = list(feature.named)
    if isinstance(feature.default, float):
        texts += ["1.1x", "2x", "0.5x", *(repr(feature.default + by) for by in (1.0, -1.0, 10.0, -10.0)), "1", "5", "2"]
    else:
        for at, by in ((0, 1), (0, -1), (-1, 1), (-1, -1)):
            values = list(feature.default)
            values[at] += by
            texts.append("[" + ",".join(map(str, values)) + "]")
    for text in texts:
        try:
            value = feature.value(text)
        except InputError:
            continue
        if value != feature.default:
            yield value


def _parting(first: list[bytes], second: list[bytes]) -> int:
    return next((at for at, pair in enumerate(zip(first, second, strict=False)) if pair[0] != pair[1]), len(first))
