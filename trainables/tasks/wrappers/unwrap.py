"""Removes the wrappers of a Gymnasium environment."""

from __future__ import annotations

from gymnasium import Env
from gymnasium.wrappers import OrderEnforcing, PassiveEnvChecker, TimeLimit

NO_LIMIT = 2**62


def unwrap(env: Env) -> tuple[Env, int]:
    """Return the environment without wrappers that only count steps or check calls, and its time limit in steps."""
    limit = NO_LIMIT
    while isinstance(env, TimeLimit | OrderEnforcing | PassiveEnvChecker):
        if isinstance(env, TimeLimit):
            limit = min(limit, int(env._max_episode_steps))
        env = env.env
    return env, limit
