"""Algorithm 2 with a dimensionless factor: delta's excess over the source's error, divided by the range of A_src."""

from __future__ import annotations

import math

import numpy as np
import torch

from trainables.delta.sample import delta_samples
from trainables.learners.advice import DeltaShaping, Run, best_action
from trainables.learners.advice_statistics import largest_delta, take_note
from trainables.networks.network import Network, new_network
from trainables.numerics.matmul import F32
from trainables.numerics.rng import seed_sequence, stream
from trainables.tasks.registry import parse_task
from trainables.tasks.rollout import Rollout, Transitions

EPSILONS = (0.0, 0.1, 0.4, 1.0)
"""epsilon of the episodes on the source's own task, in turn; exploration on the target covers the same range."""
EPISODES = 8
QUANTILE = 0.9


class RelativeDelta(DeltaShaping):
    """The factor exp(-e(s) / u), where u is the mean range of A_src on the source's own task, and e(s) an excess.

    A second delta network, delta_0, is trained on the source's own task, where delta is only the source's error. e(s)
    is the excess of max_a |delta(s,a)| over the 90 % quantile of delta_0 there, or max_a |delta(s,a) - delta_0(s,a)|.
    """

    delta: Network

    def begin(self, run: Run) -> None:
        """Play the source on its own task, and measure delta_0 and the range of A_src there."""
        task = run.cell.sources[0].task
        with Rollout(parse_task(task), stream(run.cell.seed, "calibration", task)) as rollout:
            episodes = [rollout.episode(self.source, EPSILONS[i % len(EPSILONS)]) for i in range(EPISODES)]
        seen = Transitions(*(np.concatenate(column) for column in zip(*episodes, strict=True)))
        generator = torch.Generator()
        generator.manual_seed(int(seed_sequence(run.cell.seed, "calibration", task).generate_state(1)[0]))
        rng = stream(run.cell.seed, "advice", task)
        self._floor = self._trained(seen, run.q, generator, rng)
        q_src = self.source.rows(seen.observations).astype(np.float64)
        self._unit = max(float((q_src.max(axis=1) - q_src.min(axis=1)).mean()), 1e-6)
        self._quantile = float(np.quantile(largest_delta(self._floor, seen.observations), QUANTILE))
        self._exponent = np.zeros(1, np.float32)

    def _trained(self, seen: Transitions, q: Network, generator: torch.Generator, rng: np.random.Generator) -> Network:
        """Return delta_0, trained like delta but on transitions of the source's own task."""
        settings = self.settings.model_copy(update={"loss": "squared"})
        shape = seen.observations.shape[1], self.source.rows(seen.observations[:1]).shape[1]
        network = new_network(settings, *shape, settings.delta_learning_rate, generator, shares_with=q)
        targets = delta_samples(self.source, seen, settings.gamma)
        for _ in range(settings.floor_updates):
            at = rng.integers(len(targets), size=settings.batch_size)
            x = np.ascontiguousarray(seen.observations[at].T).ravel()
            network.update(x, seen.actions[at], targets[at])
        return network

    def best(self, q: F32, observation: F32) -> int:
        """Return argmax_a Q + kappa exp(-e / u) A_src."""
        delta = self.delta.row(observation)
        if self.settings.floor == "state":
            excess = float(np.abs(delta - self._floor.row(observation)).max())
        else:
            excess = max(0.0, float(np.abs(delta).max()) - self._quantile)
        self._exponent[0] = excess / self._unit
        take_note(self.advised, delta, self._exponent)
        return int(best_action(q, self.source.row(observation), self._exponent, self.kappa))

    def factor(self, observations: F32) -> F32:
        """Return exp(-e / u) at each observation, (n,)."""
        delta = self.delta.rows(observations)
        if self.settings.floor == "state":
            excess = np.abs(delta - self._floor.rows(observations)).max(axis=1)
        else:
            excess = np.maximum(np.abs(delta).max(axis=1) - np.float32(self._quantile), np.float32(0))
        return np.array([math.exp(-each / self._unit) for each in excess.tolist()], np.float32)

    def statistics(self, observations: F32) -> dict[str, float]:
        """Return the statistics of Algorithm 2, the factor without kappa, the unit u and the quantile."""
        found = {"advice_range": self._unit, "delta_floor": self._quantile}
        if len(observations) and not self.delta_rests:
            found["delta_factor"] = float(self.factor(observations).astype(np.float64).mean())
        return super().statistics(observations) | found
