"""Kickstarting: Q learns from the source's policy in addition to its targets."""

from __future__ import annotations

from trainables.learners.baselines.annealed import Annealed
from trainables.learners.replay_buffer import Batch
from trainables.networks.network import Network


class Kickstart(Annealed):
    """Adds kappa_t weight KL(softmax(Q_src / temperature), softmax(Q / temperature)) to the minibatch's loss."""

    def learn(self, q: Network, batch: Batch) -> float:
        """Update Q by both losses."""
        observations = batch.observations.reshape(-1, len(batch.actions)).T
        teacher = self.source.rows(observations)
        weight = self.kappa * self.settings.weight
        given = batch.observations, batch.actions, batch.td_targets
        return q.distil(*given, teacher, weight, self.settings.temperature)
