"""The replay buffer and its minibatches."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from trainables.numerics.jit import compiled
from trainables.numerics.matmul import F32
from trainables.tasks.rollout import Transitions

I64 = NDArray[np.int64]

BLOCK = 1024
"""Minibatches whose indices are drawn at once."""


class Memory(NamedTuple):
    """The transitions of the replay buffer, one per row."""

    observations: F32
    """(capacity, inputs)."""
    actions: I64
    rewards: F32
    next_observations: F32
    """(capacity, inputs)."""
    terminated: NDArray[np.bool_]
    cut: NDArray[np.bool_]
    """Whether the target of Q does not bootstrap: where terminated, and if the agent says so where truncated."""


class Batch(NamedTuple):
    """A minibatch of B transitions; the next one overwrites it."""

    indices: I64
    """(B,): their indices in the buffer."""
    observations: F32
    """(inputs, B), flat: the batch is last."""
    actions: I64
    """(B,)."""
    td_targets: F32
    """(B,)."""
    delta_targets: F32
    """(B,)."""


@compiled
def gather(
    drawn: I64,
    observations: F32,
    actions: I64,
    targets: F32,
    indices: I64,
    batch_observations: F32,
    batch_actions: I64,
    batch_targets: F32,
    size: int,
    head: int,
    stale: int,
) -> bool:
    """Fill a minibatch; return whether it has one of the `stale` newest transitions, which are before `head`.

    Shapes as in `Memory` and `Batch`; targets (2, capacity) and batch_targets (2, B): those of Q, then of delta. The
    arguments are no named tuples, since numba would unpack these in every call from Python.
    """
    capacity, inputs = observations.shape
    count = len(drawn)
    found = False
    for j in range(count):
        i = (drawn[j] * size) >> 32
        age = head - 1 - i
        found |= (age if age >= 0 else age + capacity) < stale
        indices[j] = i
        for k in range(inputs):
            batch_observations[k * count + j] = observations[i, k]
        batch_actions[j] = actions[i]
        batch_targets[0, j] = targets[0, i]
        batch_targets[1, j] = targets[1, i]
    return found


class Targets(Protocol):
    """The interface of the targets for `sample` (`TargetCache`)."""

    targets: F32
    """(2, capacity): those of Q, then of delta."""
    stale: int
    """Number of the newest transitions without a valid target of Q."""

    def refresh(self, replay: Replay) -> None:
        """Compute the stale targets."""


class Replay:
    """The last `capacity` transitions, and minibatches drawn from them uniformly with replacement."""

    def __init__(self, capacity: int, inputs: int, batch_size: int, rng: np.random.Generator) -> None:
        self.memory = Memory(
            np.zeros((capacity, inputs), np.float32),
            np.zeros(capacity, np.int64),
            np.zeros(capacity, np.float32),
            np.zeros((capacity, inputs), np.float32),
            np.zeros(capacity, np.bool_),
            np.zeros(capacity, np.bool_),
        )
        self.batch_targets = np.zeros((2, batch_size), np.float32)
        self.batch = Batch(
            np.zeros(batch_size, np.int64),
            np.zeros(inputs * batch_size, np.float32),
            np.zeros(batch_size, np.int64),
            *self.batch_targets,
        )
        self.capacity = capacity
        self.size = self.head = 0
        self._rng = rng
        self.drawn = np.zeros((0, batch_size), np.int64)
        """(BLOCK, B): 32 random bits for each transition of the next minibatches."""
        self._before_draw, self.next = rng.bit_generator.state, 0

    def add(
        self, observation: F32, action: int, reward: float, next_observation: F32, terminated: bool, cut: bool
    ) -> None:
        """Add a transition, replacing the oldest if the buffer is full."""
        memory, at = self.memory, self.head
        memory.observations[at] = observation
        memory.next_observations[at] = next_observation
        memory.actions[at] = action
        memory.rewards[at] = reward
        memory.terminated[at] = terminated
        memory.cut[at] = cut
        self.head = at + 1 if at + 1 < self.capacity else 0
        if self.size < self.capacity:
            self.size += 1

    def sample(self, targets: Targets) -> Batch:
        """Draw a minibatch with valid targets."""
        self.next += 1
        if self.next >= len(self.drawn):
            self.draw()
        if self._fill(targets):
            targets.refresh(self)
            self._fill(targets)
        return self.batch

    def _fill(self, targets: Targets) -> bool:
        """Fill the minibatch drawn last, by 32 random bits per transition; return whether a target in it is stale."""
        memory, batch = self.memory, self.batch
        return gather(
            self.drawn[self.next], memory.observations, memory.actions, targets.targets,
            batch.indices, batch.observations, batch.actions, self.batch_targets,
            self.size, self.head, targets.stale,
        )  # fmt: skip

    def transitions(self, part: slice | I64) -> Transitions:
        """Return the transitions in a slice or at indices."""
        m = self.memory
        return Transitions(
            m.observations[part], m.actions[part], m.rewards[part], m.next_observations[part], m.terminated[part]
        )

    def newest(self, count: int) -> Iterator[slice]:
        """Return the slices with the `count` newest transitions."""
        if count > self.head:
            yield slice(self.capacity - (count - self.head), self.capacity)
        if count and self.head:
            yield slice(max(self.head - count, 0), self.head)

    def draw(self) -> None:
        """Draw the indices of the next BLOCK minibatches."""
        self._before_draw = self._rng.bit_generator.state
        shape = (BLOCK, len(self.batch.indices))
        self.drawn = self._rng.integers(0, 2**32, size=shape, dtype=np.int64)
        self.next = 0

    def state(self) -> dict[str, Any]:
        """Return everything for a checkpoint, of the arrays only the filled part."""
        arrays = {name: column[: self.size].copy() for name, column in self.memory._asdict().items()}
        numbers = {"size": self.size, "head": self.head, "drawn": len(self.drawn), "next": self.next}
        return arrays | numbers | {"rng": self._before_draw}

    def restore(self, state: Mapping[str, Any]) -> None:
        """Restore what `state` returned."""
        self.size, self.head = int(state["size"]), int(state["head"])
        for name, column in self.memory._asdict().items():
            column[: self.size] = state[name]
        self._rng.bit_generator.state = state["rng"]
        self._before_draw = state["rng"]
        if state["drawn"]:
            self.draw()
        self.next = int(state["next"])
