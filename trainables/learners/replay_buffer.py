"""The replay buffer, with the parts of every transition's target that change seldom kept beside it."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from trainables.numerics.jit import compiled
from trainables.numerics.matmul import F32

I64 = NDArray[np.int64]

BLOCK = 1024
"""Minibatches whose indices are drawn together."""


@compiled
def _gather(
    drawn: I64,
    observations: F32,
    actions: I64,
    rewards: F32,
    future: F32,
    advice: F32,
    delta: F32,
    indices: I64,
    x: F32,
    chosen: I64,
    targets: F32,
    delta_targets: F32,
    size: int,
    head: int,
    stale: int,
) -> bool:
    """Fill the minibatch; whether it holds one of the `stale` newest transitions, those before `head`."""
    capacity, n_in = observations.shape
    batch = len(drawn)
    found = False
    for j in range(batch):
        i = (drawn[j] * size) >> 32
        age = head - 1 - i
        found |= (age if age >= 0 else age + capacity) < stale
        indices[j] = i
        for k in range(n_in):
            x[k * batch + j] = observations[i, k]
        chosen[j] = actions[i]
        targets[j] = rewards[i] - advice[i] + future[i]
        delta_targets[j] = delta[i]
    return found


class Replay:
    """The last `capacity` transitions, and minibatches drawn from them uniformly with replacement.

    A transition's target is reward - advice + future: `future` is gamma max_b of the target network at s' (0 where
    terminated), `advice` the potential at (s,a) of an agent that shapes the reward. Both hold until the target
    network is copied, so the learner computes them once, for many transitions at a time, when a minibatch first
    needs one of them; `stale` counts the newest transitions for which that is still to be done. `delta` is the
    target of eq. (4), which never changes; `stale_delta` counts likewise.
    """

    def __init__(self, capacity: int, inputs: int, batch_size: int, rng: np.random.Generator) -> None:
        self.observations, self.next_observations = (np.zeros((capacity, inputs), np.float32) for _ in range(2))
        self.actions = np.zeros(capacity, np.int64)
        self.rewards, self.future, self.advice, self.delta = (np.zeros(capacity, np.float32) for _ in range(4))
        self.terminated = np.zeros(capacity, np.bool_)
        self.size = self.head = self.stale = self.stale_delta = 0
        self.x = np.zeros(inputs * batch_size, np.float32)
        """Observations of the minibatch, (inputs, batch), flat."""
        self.chosen = np.zeros(batch_size, np.int64)
        self.targets, self.delta_targets = (np.zeros(batch_size, np.float32) for _ in range(2))
        self._capacity, self._rng = capacity, rng
        self.indices = np.zeros(batch_size, np.int64)
        self._drawn = np.zeros((0, batch_size), np.int64)
        self._before_draw, self._next = rng.bit_generator.state, 0

    def add(self, observation: F32, action: int, reward: float, next_observation: F32, terminated: bool) -> None:
        """Remember one transition in place of the oldest."""
        at = self.head
        self.observations[at] = observation
        self.next_observations[at] = next_observation
        self.actions[at] = action
        self.rewards[at] = reward
        self.terminated[at] = terminated
        self.head = at + 1 if at + 1 < self._capacity else 0
        if self.size < self._capacity:
            self.size += 1
        self.stale = min(self.stale + 1, self.size)
        self.stale_delta = min(self.stale_delta + 1, self.size)

    def sample(self) -> bool:
        """Draw a minibatch into indices, x, chosen and targets.

        True where it holds a transition whose target is stale: `gather` again once it is not.
        """
        self._next += 1
        if self._next >= len(self._drawn):
            self._draw()
        return self.gather()

    def gather(self) -> bool:
        """Fill the arrays from the minibatch drawn last: 32 random bits each, scaled to the number of transitions."""
        drawn = self._drawn[self._next]
        return bool(
            _gather(
                drawn, self.observations, self.actions, self.rewards, self.future, self.advice, self.delta,
                self.indices, self.x, self.chosen, self.targets, self.delta_targets, self.size, self.head, self.stale,
            )
        )  # fmt: skip

    def newest(self, count: int) -> Iterator[slice]:
        """The slices that the `count` newest transitions lie in."""
        if count > self.head:
            yield slice(self._capacity - (count - self.head), self._capacity)
        if count and self.head:
            yield slice(max(self.head - count, 0), self.head)

    def _draw(self) -> None:
        self._before_draw = self._rng.bit_generator.state
        shape = (BLOCK, len(self.chosen))
        self._drawn = self._rng.integers(0, 2**32, size=shape, dtype=np.int64)
        self._next = 0

    _ARRAYS = ("observations", "next_observations", "actions", "rewards", "future", "advice", "delta", "terminated")
    _NUMBERS = ("size", "head", "stale", "stale_delta")

    def state(self) -> dict[str, Any]:
        """Everything, for a checkpoint; of the arrays what has been filled."""
        arrays = {name: getattr(self, name)[: self.size].copy() for name in self._ARRAYS}
        numbers = {name: getattr(self, name) for name in self._NUMBERS}
        return arrays | numbers | {"rng": self._before_draw, "drawn": len(self._drawn), "next": self._next}

    def restore(self, state: Mapping[str, Any]) -> None:
        """Go back to what `state` returned."""
        for name in self._NUMBERS:
            setattr(self, name, int(state[name]))
        for name in self._ARRAYS:
            getattr(self, name)[: self.size] = state[name]
        self._rng.bit_generator.state = state["rng"]
        self._before_draw = state["rng"]
        if state["drawn"]:
            self._draw()
        self._next = int(state["next"])
