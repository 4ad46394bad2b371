"""Tabular sources on a tabular target: every transition updates the estimates of all of them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from trainables.numerics.jit import compiled
from trainables.numerics.rng import stream
from trainables.source_ranking.path_value import Follower, Following, Seen, merged, nothing_seen
from trainables.tasks.registry import parse_task
from trainables.tasks.tabular_env import step as env_step

RANDOM = np.zeros(0, np.int64)
"""The empty policy: uniformly random actions."""


@compiled
def _episode(
    kind: int,
    parameters: NDArray[np.float64],
    start: int,
    time_limit: int,
    shape: tuple[int, int],
    pi: NDArray[np.int64],
    rng: np.random.Generator,
) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """Play an episode; return (steps, 3) states, actions and next states (S: the end), and (steps,) rewards."""
    where, rewards = np.zeros((time_limit, 3), np.int64), np.zeros(time_limit)
    state, t = start, 0
    while t < time_limit:
        action = int(rng.integers(0, shape[1])) if len(pi) == 0 else pi[state]
        next_state, reward, terminated = env_step(kind, state, action, parameters, rng)
        where[t, 0], where[t, 1], where[t, 2] = state, action, shape[0] if terminated else next_state
        rewards[t] = reward
        t += 1
        state = next_state
        if terminated:
            break
    return where[:t], rewards[:t]


class Player:
    """A tabular task on which policies are played, with the observed transitions."""

    def __init__(self, task: str, seed: int) -> None:
        dynamics = parse_task(task).dynamics()
        self.shape, self.start = (dynamics.states, dynamics.actions), dynamics.start
        self._where = dynamics.kind, dynamics.parameters, dynamics.start, dynamics.time_limit
        self._rng = stream(seed, "calibration", task)
        self.seen = nothing_seen()
        self.steps = 0

    def play(self, pi: NDArray[np.int64], gamma: float) -> float:
        """Play an episode under pi (S,), or RANDOM; return its discounted return."""
        where, rewards = _episode(*self._where, self.shape, pi, self._rng)
        state, action, next_state = (np.ascontiguousarray(column) for column in where.T)
        seen = Seen(state, action, next_state, np.ones(len(rewards)), rewards, rewards**2)
        self.seen = merged(self.seen, seen, *self.shape)
        self.steps += len(rewards)
        return float(gamma ** np.arange(len(rewards)) @ rewards)


class TabularComparison:
    """The comparison of tabular sources on a tabular target."""

    def __init__(
        self, target: str, sources: Sequence[tuple[str, NDArray[np.float64]]], gamma: float, seed: int
    ) -> None:
        self._player = Player(target, seed)
        self._sources, self._gamma, self._seed = sources, gamma, seed
        self._followers = [Follower(q, self._player.start, gamma) for _, q in sources]

    @property
    def steps(self) -> int:
        """Return the steps taken on the target."""
        return self._player.steps

    def play(self, source: int | None) -> float:
        """Play a target episode; return its discounted return."""
        return self._player.play(RANDOM if source is None else self._followers[source].pi, self._gamma)

    def close(self) -> None:
        """Do nothing: there is no environment."""

    def values(self) -> list[float]:
        """Return the estimated return of following each source."""
        return [follower.value(self._player.seen) for follower in self._followers]

    def estimates(self) -> list[Following]:
        """Return the final estimate for each source."""
        return [follower.estimate(self._player.seen) for follower in self._followers]

    def floors(self, episodes: Sequence[int]) -> list[Following]:
        """Return the estimate for each source followed on its own task."""
        found = []
        for (task, q), number in zip(self._sources, episodes, strict=True):
            own = Player(task, self._seed)
            follower = Follower(q, own.start, self._gamma)
            for _ in range(number):
                own.play(follower.pi, self._gamma)
            found.append(follower.estimate(own.seen))
        return found
