"""A gated initialisation: the source's values where the target is still unknown."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from trainables.agents.builtin.dqn import DQN
from trainables.learners.advice import Advice, Run
from trainables.networks.network import Network
from trainables.numerics.matmul import F32
from trainables.numerics.rng import stream
from trainables.tasks.registry import parse_task
from trainables.tasks.rollout import Rollout, Transitions

EPISODES = 8
"""Episodes on the source's own task, half of them with random actions, whose states define the bins."""


class GatedInit(Advice):
    """The values k(s) Q + (1 - k(s)) Q_src for choosing actions, for targets and for evaluation.

    k(s) = min(1, n / known_after) measures how well s is known; n counts the visits to its bin. The bins are quantiles
    of each input.
    """

    settings: Any
    source: Network

    def __init__(
        self, settings: DQN, source: Network | None = None, delta: Network | None = None, source_steps: int = 0
    ) -> None:
        super().__init__(settings, source, delta, source_steps)
        self.kappa = 1.0
        self._visits: dict[int, int] = {}

    def begin(self, run: Run) -> None:
        """Define the bins by states of the source's own task."""
        task = run.cell.sources[0].task
        with Rollout(parse_task(task), stream(run.cell.seed, "calibration", task)) as rollout:
            states = [rollout.episode(self.source, float(i % 2)).observations for i in range(EPISODES)]
        shares = np.arange(1, self.settings.bins) / self.settings.bins
        self._edges = np.quantile(np.concatenate(states), shares, axis=0).T
        self._places = self.settings.bins ** np.arange(len(self._edges), dtype=np.int64)

    def _bins(self, observations: F32) -> NDArray[np.int64]:
        """Return the number of each observation's bin, (n,)."""
        digits = [np.searchsorted(edges, column) for edges, column in zip(self._edges, observations.T, strict=True)]
        numbers: NDArray[np.int64] = self._places @ np.array(digits, np.int64)
        return numbers

    def known(self, observations: F32) -> F32:
        """Return k(s) at each observation, (n,)."""
        visits = [self._visits.get(number, 0) for number in self._bins(observations).tolist()]
        result: F32 = np.minimum(np.array(visits, np.float32) / np.float32(self.settings.known_after), np.float32(1))
        return result

    def guided(self, observation: F32) -> int | None:
        """Count the visit; the agent itself acts."""
        number = int(self._bins(observation[None])[0])
        self._visits[number] = self._visits.get(number, 0) + 1
        return None

    def best(self, q: F32, observation: F32) -> int:
        """Return the action with the largest mixed value."""
        return int(self.evaluated(q[None], observation[None])[0].argmax())

    def shape_reward(self, seen: Transitions, values: F32) -> F32:
        """Return the unchanged rewards, and mix the values at s'."""
        values[:] = self.evaluated(values, seen.next_observations)
        return seen.rewards

    def evaluated(self, values: F32, observations: F32) -> F32:
        """Return k Q + (1 - k) Q_src."""
        known = self.known(observations)[:, None]
        mixed: F32 = known * values + (np.float32(1) - known) * self.source.rows(observations)
        return mixed

    def statistics(self, observations: F32) -> dict[str, float]:
        """Return the mean of k over states (n, inputs), and the number of visited bins."""
        found = {"visited_bins": float(len(self._visits))}
        return found | ({"known": float(self.known(observations).mean())} if len(observations) else {})

    def state(self) -> dict[str, Any]:
        """Return the visits."""
        return {"visits": np.array(list(self._visits.items()), np.int64).reshape(-1, 2)}

    def restore(self, state: Mapping[str, Any]) -> None:
        """Go back to what `state` returned."""
        self._visits = {int(number): int(count) for number, count in state["visits"]}
