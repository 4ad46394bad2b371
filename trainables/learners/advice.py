"""Advice from a source task: the strategies that add it to Q, and how it fades (eqs. 3, 5 and 6).

An agent's hyperparameters name its strategy (`DQN.advice`); a new agent may bring another class like these.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import Any, ClassVar, NamedTuple

import numpy as np

from trainables.agents.builtin.dqn import DQN
from trainables.cell import Cell
from trainables.delta.sample import chosen
from trainables.errors import InputError
from trainables.learners.advice_statistics import (
    NO_DELTA,
    advised_statistics,
    delta_statistics,
    largest_delta,
    take_note,
)
from trainables.learners.replay_buffer import Batch, Replay
from trainables.networks.network import Network
from trainables.numerics.jit import compiled
from trainables.numerics.matmul import F32
from trainables.tasks.rollout import Transitions


@compiled
def best_action(q: F32, q_src: F32, delta: F32, kappa: float) -> int:
    """Return argmax_a q + kappa exp(-max_b |delta|) A_src, the lowest index on ties; V_src cancels in the argmax."""
    largest = np.float32(0.0)
    for a in range(len(delta)):
        largest = max(largest, abs(delta[a]))
    scale = kappa * math.exp(-largest)
    best, at = q[0] + scale * q_src[0], 0
    for a in range(1, len(q)):
        value = q[a] + scale * q_src[a]
        if value > best:
            best, at = value, a
    return at


class Follows(NamedTuple):
    """The networks on which the advice depends."""

    source: Network | None = None
    """Q_src; None: there is no advice now, the action is argmax Q."""
    delta: Network | None = None
    fixed_delta: F32 = NO_DELTA
    """The value of delta(s, .) without a delta network."""


class Run(NamedTuple):
    """The parts of a training run that a strategy may use."""

    cell: Cell
    q: Network
    target: Network
    exploration: np.random.Generator
    remembered: Callable[[], F32]
    """Returns states from the replay buffer, (n, inputs)."""
    replay: Replay


class Advice:
    """No advice: the agent acts on Q and learns from unshaped rewards. The base class of every strategy."""

    learns_delta: ClassVar[bool] = False
    """Whether the agent trains a delta network, by eq. (4)."""
    kappa = 0.0
    """The weight of the advice in choosing actions; 0: there is none, or it has ended."""
    delta_rests = False
    """Whether the delta network is no longer trained."""
    decrement = 0.0
    """C of eq. (6), the decrease of kappa per step."""

    def __init__(
        self, settings: DQN, source: Network | None = None, delta: Network | None = None, source_steps: int = 0
    ) -> None:
        """source_steps: T, the steps of the source run."""
        self.settings, self.source, self.delta = settings, source, delta
        self.advised = np.zeros(4)
        """The steps since the last evaluation whose action was chosen with advice, as `take_note` counts them."""

    def begin(self, run: Run) -> None:
        """Prepare before the first episode."""

    def episode(self, number: int) -> None:
        """Prepare for an episode; the first is number 0."""

    def ended(self, undiscounted: float) -> None:
        """Take note of the undiscounted return of the training episode that has ended."""

    def guided(self, observation: F32) -> int | None:
        """Return the source's action where the source acts instead of the agent, else None. Called while kappa > 0."""
        return None

    def decay(self) -> bool:
        """Update kappa as in line 5, and return whether the advice ended with this step."""
        return False

    def end(self, observations: F32) -> None:
        """Note that the advice has ended; `observations` (n, inputs) are states from the replay buffer."""

    def follows(self) -> Follows:
        """Return what `best` depends on now."""
        return Follows()

    def best(self, q: F32, observation: F32) -> int:
        """Return the best action with advice, where the agent's values are q (actions,)."""
        return int(q.argmax())

    def shape_reward(self, seen: Transitions, values: F32) -> F32:
        """Return the rewards (n,) to learn from, and change `values` (n, actions) at s' to those to maximise there."""
        return seen.rewards

    def learn(self, q: Network, batch: Batch) -> float:
        """Update Q by a minibatch and return the loss. Called while kappa > 0."""
        return q.update(batch.observations, batch.actions, batch.td_targets)

    def evaluated(self, values: F32, observations: F32) -> F32:
        """Return the values (n, actions) that greedy evaluation maximises; `values` (n, actions), Q's, may change."""
        return values

    def kept(self, q: Network) -> Network:
        """Return the network that is kept as what the agent has learned: `q`, or another one that is better now."""
        return q

    def statistics(self, observations: F32) -> dict[str, float]:
        """Return the advice's statistics over states (n, inputs)."""
        return {}

    def advised_statistics(self) -> dict[str, float]:
        """Return statistics of the steps that were advised since the last evaluation; empty without any."""
        return {}

    def state(self) -> dict[str, Any]:
        """Return what changes during training, for a checkpoint."""
        return {}

    def restore(self, state: Mapping[str, Any]) -> None:
        """Restore what `state` returned."""


class SourceAdvantage(Advice):
    """The advice kappa_t f(s) A_src(s,a), with f = exp(-max_a |delta(s,a)|), or 1 without a delta network."""

    source: Network

    def __init__(
        self, settings: DQN, source: Network | None = None, delta: Network | None = None, source_steps: int = 0
    ) -> None:
        assert source is not None
        super().__init__(settings, source, delta, source_steps)
        self.kappa = 1.0

    def follows(self) -> Follows:
        """Return the source and the delta network."""
        return Follows(self.source, self.delta)

    def best(self, q: F32, observation: F32) -> int:
        """Return the action of eq. (5), or of eq. (3) without delta."""
        source, network, fixed = self.follows()
        if source is None:
            return int(q.argmax())
        delta = fixed if network is None else network.row(observation)
        take_note(self.advised, delta, delta)
        return int(best_action(q, source.row(observation), delta, self.kappa))

    def rows(self, observations: F32) -> F32:
        """Return the advice (n, actions) at observations (n, inputs): -kappa_t f(s) Phi(s,a) of eqs. (3) and (5)."""
        q_src = self.source.rows(observations)
        advantage = q_src - q_src.max(axis=1, keepdims=True)
        result: F32 = advantage * (self.kappa * self.factor(observations)[:, None]).astype(np.float32)
        return result

    def factor(self, observations: F32) -> F32:
        """Return exp(-max_a |delta(s,a)|) at each observation, (n,); 1 without delta."""
        if self.delta is None:
            return np.ones(len(observations), np.float32)
        result: F32 = np.exp(-largest_delta(self.delta, observations))
        return result

    def statistics(self, observations: F32) -> dict[str, float]:
        """Return kappa, the mean factor times kappa, and the mean and quantiles of max_a |delta|."""
        found = {"kappa": self.kappa}
        if not len(observations):
            return found
        found["advice_factor"] = float((self.kappa * self.factor(observations)).mean())
        return found if self.delta is None else found | delta_statistics(self.delta, observations)

    def advised_statistics(self) -> dict[str, float]:
        """Return the mean factor at the advised states, without kappa, and with a delta network max_a |delta| there.

        Where the factor is not the paper's exp(-max_a |delta|), the mean of that too.
        """
        return advised_statistics(self.advised, self.follows().delta is not None)

    def state(self) -> dict[str, Any]:
        """Return kappa."""
        return {"kappa": self.kappa}

    def restore(self, state: Mapping[str, Any]) -> None:
        """Restore what `state` returned."""
        self.kappa = float(state["kappa"])


class ExplicitShaping(SourceAdvantage):
    """Explicit shaping: acts on Q + kappa_t A_src, eq. (3), until kappa is 0, eq. (6)."""

    settings: Any

    def __init__(
        self, settings: DQN, source: Network | None = None, delta: Network | None = None, source_steps: int = 0
    ) -> None:
        super().__init__(settings, source, delta, source_steps)
        self.decrement = decay_constant(self.settings.advice_fraction, source_steps)

    def decay(self) -> bool:
        """Set kappa_t = max(0, kappa_{t-1} - C), eq. (6), and return whether it has become 0."""
        before = self.kappa
        self.kappa = max(0.0, before - self.decrement)
        return self.kappa == 0.0 < before

    def evaluated(self, values: F32, observations: F32) -> F32:
        """Return Q, or with `evaluation_policy: shaped` the values on which the agent acts."""
        return values + self.rows(observations) if self.settings.evaluation_policy == "shaped" else values


class DeltaShaping(ExplicitShaping):
    """Explicit shaping scaled by exp(-max_a |delta(s,a)|), eq. (5): Algorithm 2."""

    learns_delta = True

    def __init__(
        self, settings: DQN, source: Network | None = None, delta: Network | None = None, source_steps: int = 0
    ) -> None:
        super().__init__(settings, source, delta, source_steps)
        self._may_rest = self.settings.delta_after_advice == "rest"
        self._at_the_end: dict[str, float] = {}
        """delta's statistics at the end of the advice, if delta is not trained from then on."""

    def end(self, observations: F32) -> None:
        """Stop training delta, which can change no action now; its statistics stay those over these states."""
        if self._may_rest:
            assert self.delta is not None
            self.delta_rests = True
            self._at_the_end = delta_statistics(self.delta, observations)

    def statistics(self, observations: F32) -> dict[str, float]:
        """Return the statistics of explicit shaping, and whether those of delta are from the end of the advice."""
        if self.delta_rests:
            return {"kappa": 0.0, "advice_factor": 0.0, **self._at_the_end, "delta_rests": 1.0}
        return super().statistics(observations) | ({"delta_rests": 0.0} if self._may_rest else {})

    def state(self) -> dict[str, Any]:
        """Return kappa, and delta's statistics at the end of the advice."""
        return super().state() | {"delta_rests": self.delta_rests, "at_the_end": dict(self._at_the_end)}

    def restore(self, state: Mapping[str, Any]) -> None:
        """Restore what `state` returned."""
        super().restore(state)
        self.delta_rests, self._at_the_end = bool(state["delta_rests"]), dict(state["at_the_end"])


class PotentialAdvice(SourceAdvantage):
    """Potential-based advice: learns from r + gamma Phi(s',a') - Phi(s,a), with Phi = A_src, and acts on Q + Phi."""

    def shape_reward(self, seen: Transitions, values: F32) -> F32:
        """Return r - Phi(s,a), and add Phi(s', .) to the values at s'."""
        values += self.rows(seen.next_observations)
        return seen.rewards - chosen(self.rows(seen.observations), seen.actions)

    def evaluated(self, values: F32, observations: F32) -> F32:
        """Return Q + Phi, for Q was learned under the shaped reward."""
        return values + self.rows(observations)


class DeltaPotentialAdvice(PotentialAdvice):
    """Potential-based advice with Phi = exp(-max_a |delta(s,a)|) A_src, for which delta is trained to the end."""

    learns_delta = True


def decay_constant(fraction: float, source_steps: int) -> float:
    """Return C of eq. (6), so that the advice ends after that share of the source run's steps."""
    if source_steps < 1:
        raise InputError(f"the source run must have taken at least one step (got {source_steps})")
    return 1.0 / (fraction * source_steps)
