"""A warm start that is given up: the transferred network beside one that learns from scratch."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Mapping, Sequence
from typing import Any

import torch

from trainables.agents.builtin.dqn import DQN
from trainables.learners.advice import Advice, Run
from trainables.learners.baselines.warm_start import weights
from trainables.learners.replay_buffer import Batch
from trainables.learners.targets import next_values, td_target
from trainables.networks.network import Network, new_network
from trainables.numerics.matmul import F32
from trainables.numerics.rng import seed_sequence

LEAST = 5
"""Probes of each network until they are compared."""


class SafeStart(Advice):
    """Two networks on one replay buffer: Q from scratch, as DQN's, and Q_w, which begins as Q_src.

    Both take an update in every step. Of `cycle` episodes one is a probe of Q_w and one of Q, nearly greedy; the leader
    plays the others with its own exploration. Let D be the difference of the mean returns of the last `recent` probes,
    Q_w's less Q's, and s its standard error (Welch). Q leads at first; Q_w leads once D > z s; and once D < -z s, Q_w
    is given up for good, and the agent is DQN.
    """

    settings: Any
    source: Network

    def __init__(
        self, settings: DQN, source: Network | None = None, delta: Network | None = None, source_steps: int = 0
    ) -> None:
        super().__init__(settings, source, delta, source_steps)
        self.kappa = 1.0
        self.leads = False
        """Whether Q_w leads."""
        self._episode = self._steps = 0
        self._probes: tuple[deque[float], deque[float]] = (
            deque(maxlen=self.settings.recent),
            deque(maxlen=self.settings.recent),
        )
        """Returns of the last probes of Q, and of Q_w."""

    def begin(self, run: Run) -> None:
        """Make Q_w and its target network. Raises InputError where the source's weights do not fit."""
        vector = weights(self.source, run)
        inputs = run.replay.memory.observations.shape[1]
        self._actions = self.source.rows(run.replay.memory.observations[:1]).shape[1]
        generator = torch.Generator()
        seeds = seed_sequence(run.cell.seed, "advice", run.cell.task)
        generator.manual_seed(int(seeds.generate_state(1)[0]))
        shape = inputs, self._actions, self.settings.learning_rate
        self._network = new_network(self.settings, *shape, generator, shares_with=run.q)
        self._target = new_network(self.settings, *shape, shares_with=run.q)
        if self.settings.begins == "source":
            self._network.load_vector(vector)
        self._target.load_vector(self._network.vector())
        self._q, self._replay, self._exploration = run.q, run.replay, run.exploration

    def episode(self, number: int) -> None:
        """Take note of the number of the episode that begins."""
        self._episode = number

    @property
    def _probe(self) -> int | None:
        """Which network the episode is a probe of: 0, Q; 1, Q_w; None: it is the leader's."""
        cycle = self.settings.cycle
        return {0: 1, cycle // 2: 0}.get(self._episode % cycle)

    def guided(self, observation: F32) -> int | None:
        """Return the action in a probe, or where Q_w leads; None where Q acts as DQN's does."""
        self._steps += 1
        if self._probe is None and not self.leads:
            return None
        if self._exploration.random() < self._epsilon():
            return int(self._exploration.integers(self._actions))
        network = self._q if self._probe == 0 else self._network
        return int(network.row(observation).argmax())

    def _epsilon(self) -> float:
        settings = self.settings
        if self._probe is not None:
            return float(settings.epsilon_end)
        n = self._episode if settings.epsilon_unit == "episodes" else self._steps
        fade = math.exp(-n / (settings.warm_decay_share * settings.epsilon_decay))
        return float(settings.epsilon_end + (settings.warm_epsilon - settings.epsilon_end) * fade)

    def learn(self, q: Network, batch: Batch) -> float:
        """Update both networks by the minibatch, each with targets of its own, and return the loss of Q."""
        loss = super().learn(q, batch)
        seen = self._replay.transitions(batch.indices)
        values = self._target.rows(seen.next_observations)
        choosing = self._network.rows(seen.next_observations) if self.settings.double else values
        v_next = next_values(values, choosing)
        v_next[self._replay.memory.cut[batch.indices]] = 0
        targets = td_target(seen.rewards, v_next.dtype.type(self.settings.gamma), v_next)
        loss_w = self._network.update(batch.observations, batch.actions, targets)
        if self._steps % self.settings.target_update == 0:
            self._target.load_vector(self._network.vector())
        return loss if math.isfinite(loss_w) else loss_w

    def ended(self, undiscounted: float) -> None:
        """Compare the two networks after each probe, while there are two."""
        if not self.kappa or self._probe is None:
            return
        self._probes[self._probe].append(undiscounted)
        if min(map(len, self._probes)) < LEAST:
            return
        difference, error = self.difference()
        if difference > self.settings.z * error:
            self.leads = True
        elif difference < -self.settings.z * error:
            self.leads, self.kappa = False, 0.0

    def difference(self) -> tuple[float, float]:
        """Return D, the mean return of Q_w's probes less that of Q's, and its standard error."""
        (mean, square), (mean_w, square_w) = (_mean_and_error(probes) for probes in self._probes)
        return mean_w - mean, math.sqrt(square + square_w)

    def evaluated(self, values: F32, observations: F32) -> F32:
        """Return the values of the leader."""
        return self._network.rows(observations) if self.leads else values

    def kept(self, q: Network) -> Network:
        """Return the leader."""
        return self._network if self.leads else q

    def statistics(self, observations: F32) -> dict[str, float]:
        """Return whether Q_w leads, whether it was given up, and D with its standard error once it is known."""
        found = {"transfer_leads": float(self.leads), "given_up": float(not self.kappa)}
        if min(map(len, self._probes)) >= LEAST:
            found |= dict(zip(("probe_difference", "probe_error"), self.difference(), strict=True))
        return found

    def state(self) -> dict[str, Any]:
        """Return both networks' part of the state, the probes, and who leads."""
        return {
            "network": self._network.state(),
            "target": self._target.state(),
            "probes": [list(probes) for probes in self._probes],
            "numbers": [self._steps, int(self.leads)],
            "kappa": self.kappa,
        }

    def restore(self, state: Mapping[str, Any]) -> None:
        """Go back to what `state` returned."""
        self._network.restore(state["network"])
        self._target.restore(state["target"])
        for probes, given in zip(self._probes, state["probes"], strict=True):
            probes.clear()
            probes.extend(map(float, given))
        self._steps, leads = map(int, state["numbers"])
        self.leads, self.kappa = bool(leads), float(state["kappa"])


def _mean_and_error(values: Sequence[float]) -> tuple[float, float]:
    """Return the mean, and the square of its standard error."""
    count = len(values)
    mean = math.fsum(values) / count
    return mean, math.fsum((value - mean) ** 2 for value in values) / (count - 1) / count
