"""Random streams by role, so that no part of a run affects the random numbers of another."""

from __future__ import annotations

import hashlib
from typing import Literal

import numpy as np

Role = Literal["training_env", "evaluation_env", "exploration", "network_init", "replay", "calibration", "advice"]

_SPAWN_KEYS: dict[Role, int] = {
    "training_env": 0,
    "evaluation_env": 1,
    "exploration": 2,
    "network_init": 3,
    "replay": 4,
    "calibration": 5,
    "advice": 6,
}


def seed_sequence(seed: int, role: Role, task: str) -> np.random.SeedSequence:
    """Return the seed sequence of a role in a run.

    It depends on the task's name, so that a target run does not repeat the noise of the source run with the same seed;
    it does not depend on the agent, so that agents with the same seed see the same noise (paired by seed).
    """
    digest = int.from_bytes(hashlib.sha256(task.encode()).digest()[:8], "big")
    return np.random.SeedSequence(entropy=[seed, digest], spawn_key=(_SPAWN_KEYS[role],))


def stream(seed: int, role: Role, task: str) -> np.random.Generator:
    """Return a new generator for `role`, at the start of its stream."""
    return np.random.default_rng(seed_sequence(seed, role, task))
