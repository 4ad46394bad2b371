"""Any Gymnasium environment as a task: gym:ENV_ID[:attribute.path=VALUE,...].

A context feature is an attribute path of the unwrapped environment; its value is a number, or a multiple such as 2x.
An environment with continuous actions has the feature `levels` too: gym:Pendulum-v1:levels=5 (see `discretise`).
"""

from __future__ import annotations

import functools
import importlib.util
import logging
import re
from contextlib import closing
from numbers import Real
from typing import TYPE_CHECKING, Any

from trainables.errors import InputError, unknown
from trainables.tasks.spec.family import Context, ContextFeature, TaskFamily, number

if TYPE_CHECKING:
    import gymnasium

PREFIX = "gym"

_LOG = logging.getLogger("deltatune.tasks")

LEVELS = 3.0
"""Default number of values of each dimension of a continuous action (the paper's for Reacher)."""


def split(text: str) -> tuple[str, str]:
    """Split 'gym:ENV_ID:features' into ('gym:ENV_ID', 'features'); a 'module:' in the id stays with it."""
    match = re.fullmatch(r"(gym:(?:[\w.]+:(?=[\w/-]+-v\d))?[^:]+)(?::(.*))?", text)
    if match is None:
        raise InputError(f"task '{text}': write gym:ENVIRONMENT-ID, such as gym:MountainCar-v0")
    return match.group(1), match.group(2) or ""


@functools.lru_cache(maxsize=256)
def family(name: str, paths: tuple[str, ...]) -> TaskFamily:
    """Return the family of an environment id, with the attribute `paths` as its context features.

    Raises InputError for an unknown environment, and for a path that is no number there.
    """
    from trainables.tasks.wrappers.discretise import levels_feature

    with closing(_make(name)) as env:
        levels = (levels_feature(LEVELS),) if _continuous(env) else ()
        attributes = sorted(set(paths) - {feature.name for feature in levels})
        found = tuple(_feature(name, env.unwrapped, path) for path in attributes)
        threshold = env.spec.reward_threshold if env.spec else None
    return TaskFamily(
        name,
        "a Gymnasium environment",
        levels + found,
        {},
        build=functools.partial(_build, name),
        check=functools.partial(_check, name),
        plain=functools.partial(_build, name, {}),
        solved_at=None if threshold is None else float(threshold),
    )


def _make(name: str) -> gymnasium.Env:
    import gymnasium

    identity = name.removeprefix(f"{PREFIX}:")
    module = identity.partition(":")[0] if ":" in identity else ""
    if module and importlib.util.find_spec(module.partition(".")[0]) is None:
        raise InputError(f"task '{name}': there is no module '{module}'")
    if not module and identity not in gymnasium.registry:
        raise unknown("Gymnasium environment", identity, [key for key in gymnasium.registry if key[:1] == identity[:1]])
    try:
        env = gymnasium.make(identity)
    except Exception as error:  # whatever the environment's code raises
        text = " ".join(str(error).split())
        raise InputError(f"task '{name}': {text or type(error).__name__}") from None
    return env


def _continuous(env: gymnasium.Env) -> bool:
    from gymnasium.spaces import Discrete

    return not isinstance(env.action_space, Discrete)


def _owner(env: Any, path: str) -> tuple[Any, str]:
    *parents, last = path.split(".")
    for part in parents:
        env = getattr(env, part)
    return env, last


def _feature(name: str, env: Any, path: str) -> ContextFeature:
    try:
        value = getattr(*_owner(env, path))
    except AttributeError:
        raise InputError(f"task '{name}': {path} is not an attribute of the environment") from None
    if isinstance(value, bool) or not isinstance(value, Real):
        raise InputError(f"task '{name}': {path} is not a number (it is {value!r})")
    return ContextFeature(path, float(value), "an attribute of the environment", number(-1e300, 1e300))


def _build(name: str, context: Context) -> gymnasium.Env:
    """Return the environment with the attributes of `context`, its actions discretised by `levels`."""
    from trainables.tasks.wrappers.discretise import discretise

    env = _make(name)
    values = dict(context)
    levels = values.pop("levels", LEVELS) if _continuous(env) else None
    for path, value in values.items():
        owner, last = _owner(env.unwrapped, path)
        before = getattr(owner, last)
        if value != before:
            whole = isinstance(before, int) and float(value).is_integer()
            setattr(owner, last, int(value) if whole else value)
    if levels is None:
        return env
    try:
        return discretise(env, levels)
    except InputError as error:
        env.close()
        raise InputError(f"task '{name}': {error}") from None


def _check(name: str, context: Context) -> None:
    """Raise InputError for too many actions or a value that cannot be set; warn of a change without effect."""
    values = dict(context)
    with closing(_make(name)) as plain:
        levels = {"levels": values.pop("levels")} if _continuous(plain) else {}
        changes = {path: value for path, value in values.items() if value != getattr(*_owner(plain.unwrapped, path))}
    _build(name, levels).close()
    for path, value in changes.items():
        try:
            same = _rollout(_build(name, {**levels, path: value})) == _rollout(_build(name, levels))
        except Exception as error:  # the environment's code, with a value that it may not support
            raise InputError(f"task '{name}': {path} cannot be set to {value:g} ({error})") from None
        if same:
            _LOG.warning(
                "task '%s': %s=%g changes nothing in 100 random steps; does the environment use it at all?",
                name,
                path,
                value,
            )


def _rollout(env: gymnasium.Env) -> list[bytes]:
    import numpy as np

    seen: list[bytes] = []
    with closing(env):
        env.reset(seed=0)
        space: Any = env.action_space
        for action in int(space.start) + np.random.default_rng(0).integers(0, int(space.n), 100):
            observation, reward, terminated, truncated, _ = env.step(int(action))
            seen.append(np.asarray(observation).tobytes() + np.float64(reward).tobytes())
            if terminated or truncated:
                env.reset()
    return seen
