"""Advice from a source task: each way of adding it to Q, and when it ends (eqs. 3, 5 and 6).

An agent's hyperparameters name its strategy (`DQN.advice`); an agent with another one brings a class like these.
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
from trainables.learners.replay_buffer import Batch
from trainables.networks.network import Network
from trainables.numerics.jit import compiled
from trainables.numerics.matmul import F32
from trainables.tasks.rollout import Transitions


@compiled
def best_action(q: F32, q_src: F32, delta: F32, kappa: float) -> int:
    """argmax_a q + kappa exp(-max_b |delta|) A_src, the lowest index on ties; V_src cancels out of an argmax."""
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
    """What advice is read from."""

    source: Network | None = None
    """Q_src; None: there is no advice to be had now, the action is argmax Q."""
    delta: Network | None = None
    fixed_delta: F32 = NO_DELTA
    """What stands for delta(s, .) where there is no delta network."""


class Run(NamedTuple):
    """What a strategy may use of the run that it takes part in."""

    cell: Cell
    q: Network
    target: Network
    exploration: np.random.Generator
    remembered: Callable[[], F32]
    """States that the replay buffer holds, (n, inputs)."""


class Advice:
    """No advice: the agent acts on Q and learns from the rewards as they are. The base of every strategy."""

    learns_delta: ClassVar[bool] = False
    """Whether the agent trains a delta network, by eq. (4)."""
    kappa = 0.0
    """The weight of the advice in choosing actions; 0: there is none, or it has ended."""
    delta_rests = False
    """Whether the delta network is trained no more."""
    decrement = 0.0
    """C of eq. (6): what kappa loses in a step."""

    def __init__(
        self, settings: DQN, source: Network | None = None, delta: Network | None = None, source_steps: int = 0
    ) -> None:
        """source_steps: T, the steps that the source run took."""
        self.settings, self.source, self.delta = settings, source, delta
        self.advised = np.zeros(4)
        """The steps since the last evaluation whose action was chosen with advice, as `take_note` counts them."""

    def begin(self, run: Run) -> None:
        """Do what is to be done once, before the first episode."""

    def episode(self, number: int) -> None:
        """Take note that an episode begins; the first is number 0."""

    def guided(self, observation: F32) -> int | None:
        """Return the source's action where it acts in the agent's place, else None; not asked while kappa is 0."""
        return None

    def decay(self) -> bool:
        """Take one step of line 5; whether the advice ended with it."""
        return False

    def end(self, observations: F32) -> None:
        """Take note that the advice has ended, in a run that remembers states like these (n, inputs)."""

    def follows(self) -> Follows:
        """Return what `best` reads now."""
        return Follows()

    def best(self, q: F32, observation: F32) -> int:
        """Return the action to take where the agent's own values are q (actions,)."""
        return int(q.argmax())

    def shape_reward(self, seen: Transitions, values: F32) -> F32:
        """Return the rewards (n,) to learn from; `values` (n, actions) at s' become those that are maximised there."""
        return seen.rewards

    def learn(self, q: Network, batch: Batch) -> float:
        """Update Q by a minibatch and return the loss; not asked while kappa is 0."""
        return q.update(batch.observations, batch.actions, batch.td_targets)

    def evaluated(self, values: F32, observations: F32) -> F32:
        """Return what greedy evaluation maximises, (n, actions); `values` (n, actions) are Q's, and may change."""
        return values

    def statistics(self, observations: F32) -> dict[str, float]:
        """Return what to report of the advice, over states (n, inputs)."""
        return {}

    def advised_statistics(self) -> dict[str, float]:
        """Return what to report of the steps that were advised since the last evaluation; nothing of no step."""
        return {}

    def state(self) -> dict[str, Any]:
        """Return what changes while training, for a checkpoint."""
        return {}

    def restore(self, state: Mapping[str, Any]) -> None:
        """Go back to what `state` returned."""


class SourceAdvantage(Advice):
    """The advice kappa_t f(s) A_src(s,a), with f = exp(-max_a |delta(s,a)|) of a delta network, and 1 without one."""

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
        """Return the action of eq. (5); of eq. (3) without delta."""
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

        Where the factor is not the paper's exp(-max_a |delta|), the mean of that beside it.
        """
        return advised_statistics(self.advised, self.follows().delta is not None)

    def state(self) -> dict[str, Any]:
        """Return kappa."""
        return {"kappa": self.kappa}

    def restore(self, state: Mapping[str, Any]) -> None:
        """Go back to what `state` returned."""
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
        """kappa_t = max(0, kappa_{t-1} - C): eq. (6)."""
        before = self.kappa
        self.kappa = max(0.0, before - self.decrement)
        return self.kappa == 0.0 < before

    def evaluated(self, values: F32, observations: F32) -> F32:
        """Return Q, or with `evaluation_policy: shaped` what the agent acts on."""
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
        """delta's statistics when the advice ended, where delta rests from then on."""

    def end(self, observations: F32) -> None:
        """Let delta rest, for it can change no action now; its statistics stay those over these states (n, inputs)."""
        if self._may_rest:
            assert self.delta is not None
            self.delta_rests = True
            self._at_the_end = delta_statistics(self.delta, observations)

    def statistics(self, observations: F32) -> dict[str, float]:
        """Return what every advice reports, and whether delta's statistics are those of the advice's end."""
        if self.delta_rests:
            return {"kappa": 0.0, "advice_factor": 0.0, **self._at_the_end, "delta_rests": 1.0}
        return super().statistics(observations) | ({"delta_rests": 0.0} if self._may_rest else {})

    def state(self) -> dict[str, Any]:
        """Return kappa, and delta's statistics at the advice's end."""
        return super().state() | {"delta_rests": self.delta_rests, "at_the_end": dict(self._at_the_end)}

    def restore(self, state: Mapping[str, Any]) -> None:
        """Go back to what `state` returned."""
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
    """Potential-based advice with Phi = exp(-max_a |delta(s,a)|) A_src, which follows delta to the end."""

    learns_delta = True


def decay_constant(fraction: float, source_steps: int) -> float:
    """Return C of eq. (6), so that the advice ends after that share of the source run's steps."""
    if source_steps < 1:
        raise InputError(f"the source run must have taken at least one step (got {source_steps})")
    return 1.0 / (fraction * source_steps)
