"""Learning from transitions of the source in addition to the target's."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from trainables.learners.advice import Run
from trainables.learners.baselines.annealed import Annealed
from trainables.learners.replay_buffer import Batch
from trainables.learners.targets import next_values, td_target
from trainables.networks.network import Network
from trainables.numerics.rng import stream
from trainables.tasks.registry import parse_task
from trainables.tasks.rollout import Rollout, Transitions


class SourceReplay(Annealed):
    """Half of each minibatch comes from uncorrected transitions of the source's policy on its own task.

    They are collected before training, epsilon-greedily; a hyperparameter sets their number. Once kappa is 0,
    minibatches come from the target alone, since transitions of other dynamics are biased.
    """

    def begin(self, run: Run) -> None:
        """Play the source's policy on the source task."""
        task = run.cell.sources[0].task
        episodes: list[Transitions] = []
        with Rollout(parse_task(task), stream(run.cell.seed, "calibration", task)) as rollout:
            while sum(len(episode.actions) for episode in episodes) < self.settings.source_transitions:
                episodes.append(rollout.episode(self.source, self.settings.source_epsilon))
        columns = (np.concatenate(column) for column in zip(*episodes, strict=True))
        self._seen = Transitions(*(column[: self.settings.source_transitions] for column in columns))
        self._rng = stream(run.cell.seed, "advice", run.cell.task)
        self._target = run.target

    def learn(self, q: Network, batch: Batch) -> float:
        """Update Q by the minibatch with its second half from the source."""
        size = len(batch.actions)
        half, seen = size // 2, self._seen
        at = self._rng.integers(len(seen.actions), size=half)
        values = self._target.rows(seen.next_observations[at])
        values = next_values(values, q.rows(seen.next_observations[at]) if self.settings.double else values)
        future = np.where(seen.terminated[at], np.float32(0), values)
        batch.observations.reshape(-1, size)[:, size - half :] = seen.observations[at].T
        batch.actions[size - half :] = seen.actions[at]
        batch.td_targets[size - half :] = td_target(seen.rewards[at], np.float32(self.settings.gamma), future)
        return super().learn(q, batch)

    def state(self) -> dict[str, Any]:
        """Return kappa and the random stream."""
        return super().state() | {"rng": self._rng.bit_generator.state}

    def restore(self, state: Mapping[str, Any]) -> None:
        """Go back to what `state` returned."""
        super().restore(state)
        self._rng.bit_generator.state = state["rng"]
