"""The targets of Q and delta, cached for the transitions of the replay buffer, since they rarely change."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from trainables.delta.sample import chosen, delta_sample, v_and_q
from trainables.learners.advice import Advice
from trainables.learners.replay_buffer import Batch, Replay
from trainables.networks.network import Network
from trainables.numerics.jit import compiled
from trainables.tasks.rollout import Transitions

F32 = NDArray[np.float32]


Reward = TypeVar("Reward", np.float32, F32)


@compiled
def td_target(reward: Reward, gamma: np.float32, v_next: Reward) -> Reward:
    """Return r + gamma max_b Q_target(s',b), the target of Q(s,a) in line 10: eq. (1) for a network."""
    return reward + gamma * v_next


def delta_target(reward: F32, gamma: np.float32, v_src_next: F32, q_src: F32) -> F32:
    """Return r + gamma max_b Q_src(s',b) - Q_src(s,a), the target of delta(s,a) in line 8: eq. (4)."""
    return delta_sample(reward, gamma, v_src_next, q_src)


def next_values(values: F32, choosing: F32) -> F32:
    """Return of each row of `values` (n, actions) the one where `choosing` is largest: the same array, or Q's own."""
    return chosen(values, choosing.argmax(axis=1))


def double_targets(replay: Replay, batch: Batch, q: Network, target: Network, advice: Advice) -> None:
    """Make the TD targets of a minibatch r + gamma Q_target(s', argmax_b Q(s',b)): double DQN."""
    seen = replay.transitions(batch.indices)
    choosing, values = q.rows(seen.next_observations), target.rows(seen.next_observations)
    advice.shape_reward(seen, choosing)
    reward = advice.shape_reward(seen, values)
    v_next = np.where(replay.memory.cut[batch.indices], np.float32(0), next_values(values, choosing))
    batch.td_targets[:] = td_target(reward, np.float32(advice.settings.gamma), v_next)


class TargetCache:
    """Both targets of every transition in the replay buffer, and which of them are stale.

    A TD target does not change between two copies to the target network, and a target of delta never does. Each is
    computed when a minibatch first needs it, for all transitions added meanwhile.
    """

    def __init__(self, replay: Replay, target: Network, advice: Advice, gamma: float) -> None:
        self.targets = np.zeros((2, replay.capacity), np.float32)
        self.td, self.delta = self.targets
        self.stale = self.stale_delta = 0
        """Number of the newest transitions without a valid target."""
        self._target, self._advice, self._gamma = target, advice, np.float32(gamma)

    def added(self, size: int) -> None:
        """Count a new transition; the buffer now has `size`."""
        self.stale = min(self.stale + 1, size)
        self.stale_delta = min(self.stale_delta + 1, size)

    def target_copied(self, size: int) -> None:
        """Mark every TD target as stale, since the target network has changed."""
        self.stale = size

    def refresh(self, replay: Replay) -> None:
        """Compute the stale targets."""
        for part in () if self._advice.settings.double else replay.newest(self.stale):
            self.td[part] = self._td_targets(replay.transitions(part), replay.memory.cut[part])
        self.stale = 0
        if self._advice.delta is not None and not self._advice.delta_rests:
            for part in replay.newest(self.stale_delta):
                self.delta[part] = self._delta_targets(replay.transitions(part))
            self.stale_delta = 0

    def _td_targets(self, seen: Transitions, cut: NDArray[np.bool_]) -> F32:
        values = self._target.rows(seen.next_observations)
        reward = self._advice.shape_reward(seen, values)
        return td_target(reward, self._gamma, np.where(cut, np.float32(0), values.max(axis=1)))

    def _delta_targets(self, seen: Transitions) -> F32:
        assert self._advice.source is not None
        return delta_target(seen.rewards, self._gamma, *v_and_q(self._advice.source, seen))

    def state(self) -> dict[str, Any]:
        """Return everything for a checkpoint."""
        return {"targets": self.targets.copy(), "stale": [self.stale, self.stale_delta]}

    def restore(self, state: Mapping[str, Any]) -> None:
        """Restore what `state` returned."""
        self.targets[:] = state["targets"]
        self.stale, self.stale_delta = map(int, state["stale"])
