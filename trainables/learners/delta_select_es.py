"""delta_select_es: explicit shaping by that one of several sources whose delta is smallest, or by none."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from trainables.agents.builtin.delta_select_es import DeltaSelectShaping
from trainables.cell import Cell
from trainables.delta.noise_floor import self_delta
from trainables.delta.sample import delta_samples
from trainables.knowledge import Knowledge, parts
from trainables.learners.advice import ExplicitShaping, Follows
from trainables.learners.delta_select import NONE
from trainables.learners.dqn import DeepLearner
from trainables.learners.replay_buffer import Replay
from trainables.learners.targets import TargetCache
from trainables.networks.network import Network, source_network
from trainables.numerics.matmul import F32
from trainables.tasks.rollout import Transitions

EPSILONS = (0.0, 0.1, 0.4, 1.0)
"""Where delta on a source's own task is measured; in between it is interpolated."""


class Selection(ExplicitShaping):
    """The advice kappa_t exp(-e_k) A_src,k of the source k with the smallest excess e_k, or none over the threshold.

    e_k is what the mean |delta_k| of recent transitions, less z standard errors over episodes, exceeds the mean
    |delta_k| on the source's own task by; 0 where it does not. Of those with equal e_k the smaller |delta_k| counts.
    There the source is followed with the exploration that the transitions were made with (`floor: exploring`), because
    a network errs most where its own policy does not go.
    """

    def __init__(
        self, settings: DeltaSelectShaping, sources: Sequence[Network], floors: NDArray[np.float64], steps: int
    ) -> None:
        """floors: mean |delta| of each source on its own task (K, E), at the first E of EPSILONS."""
        super().__init__(settings, sources[0], None, steps)
        self._sources, self._floors = sources, floors
        self._floor = floors[:, 0]
        """Of each source, for the transitions in `_sums`."""
        self._floor_sums = np.zeros(len(sources))
        self._sums = np.zeros((3, len(sources)))
        """Of |delta|, of its square, and of the transitions: all fading."""
        self._episodes = 0.0
        self._at, self.chosen = 0, 0
        """The best source; and the chosen one, NONE where the best is over the threshold."""
        self._excess = np.zeros(1, np.float32)

    def observe(self, seen: Transitions, episodes: int, epsilon: float) -> None:
        """Take in transitions made with that epsilon, the newest in episode number `episodes`, and choose anew."""
        fade = math.exp((self._episodes - episodes) / self.settings.memory)
        self._episodes = float(episodes)
        self._sums *= fade
        for k, source in enumerate(self._sources):
            size = np.abs(delta_samples(source, seen, self.settings.gamma)).astype(np.float64)
            self._sums[:, k] += size.sum(), (size**2).sum(), len(size)
        if self._floors.shape[1] > 1:
            now = np.array([np.interp(epsilon, EPSILONS, floors) for floors in self._floors])
            self._floor_sums = fade * self._floor_sums + now * len(seen.actions)
            self._floor = self._floor_sums / self._sums[2]
        mean, excess = self._estimates()
        self._at = int(np.lexsort((mean, excess))[0])
        self.chosen = self._at if excess[self._at] <= self.settings.threshold else NONE
        self.source = self._sources[self._at]
        self._excess[0] = excess[self._at]

    @property
    def excess(self) -> float:
        """e_k of the best source."""
        return float(self._excess[0])

    def _estimates(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Mean |delta_k| and e_k of every source."""
        mean, square = self._sums[:2] / np.maximum(self._sums[2], 1e-300)
        sd = np.sqrt(np.maximum(square - mean**2, 0.0))
        episodes = max(1.0, min(self._episodes, self.settings.memory))
        return mean, np.maximum(mean - self.settings.z * sd / math.sqrt(episodes) - self._floor, 0.0)

    def follows(self) -> Follows:
        """The chosen source and its excess; nothing without one."""
        return Follows() if self.chosen == NONE else Follows(self.source, None, self._excess)

    def factor(self, observations: F32) -> F32:
        """exp(-e_k), (n,); 0 where no source is chosen."""
        value = 0.0 if self.chosen == NONE else math.exp(-self.excess)
        return np.full(len(observations), value, np.float32)

    def state(self) -> dict[str, Any]:
        """What decides how it goes on."""
        numbers = super().state() | {"episodes": self._episodes, "chosen": self.chosen, "at": self._at}
        floors = {"floor": self._floor.copy(), "floor_sums": self._floor_sums.copy()}
        return numbers | floors | {"sums": self._sums.copy(), "excess": self._excess.copy()}

    def restore(self, state: Mapping[str, Any]) -> None:
        """Go back to what `state` returned."""
        super().restore(state)
        self._sums[:] = state["sums"]
        self._floor, self._floor_sums = (np.array(state[name]) for name in ("floor", "floor_sums"))
        self._episodes = float(state["episodes"])
        self._at, self.chosen = int(state["at"]), int(state["chosen"])
        self.source = self._sources[self._at]
        self._excess[:] = state["excess"]


class ObservedTargets(TargetCache):
    """The targets of Q, which show each new transition to the selection when they are computed."""

    def __init__(
        self, replay: Replay, target: Network, selection: Selection, gamma: float, now: Callable[[], tuple[int, float]]
    ) -> None:
        """now: the number of the episode, and its epsilon."""
        super().__init__(replay, target, selection, gamma)
        self._selection, self._now = selection, now

    def refresh(self, replay: Replay) -> None:
        """Compute what is stale, and choose the source anew."""
        super().refresh(replay)
        for part in replay.newest(self.stale_delta):
            self._selection.observe(replay.transitions(part), *self._now())
        self.stale_delta = 0


class DeepSelectLearner(DeepLearner):
    """A deep agent whose advice comes from a library."""

    _advice: Selection

    def __init__(self, cell: Cell, source: Knowledge | None) -> None:
        super().__init__(cell, source)
        now: Callable[[], tuple[int, float]] = lambda: (self._episode, self._epsilon())  # noqa: E731
        self._targets = ObservedTargets(self._replay, self._target, self._advice, self._settings.gamma, now)

    def _make_advice(self, cell: Cell, source: Knowledge | None) -> Selection:
        settings = self._settings
        assert isinstance(settings, DeltaSelectShaping)
        assert source is not None
        shape = self._env.inputs, self._env.actions
        given = list(zip(cell.sources, parts(source, len(cell.sources)), strict=True))
        networks = [source_network(part, named.checkpoint, settings, *shape, self._q) for named, part in given]
        epsilons = EPSILONS if settings.floor == "exploring" else EPSILONS[:1]
        floors = [
            [self_delta(net, named.task, settings.gamma, cell.seed, epsilon=e).mean_abs for e in epsilons]
            for (named, _), net in zip(given, networks, strict=True)
        ]
        named, part = given[0]
        steps = int(part.arrays["steps"]) if named.steps is None else named.steps
        return Selection(settings, networks, np.array(floors), steps)

    def _statistics(self) -> dict[str, float]:
        own = {"source": float(self._advice.chosen), "delta_excess": self._advice.excess}
        return super()._statistics() | own
