"""delta_select_es: explicit shaping by the source of a library whose delta is smallest, or by none."""

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
"""Values of epsilon at which delta on a source's own task is measured; in between it is interpolated."""


class Selection(ExplicitShaping):
    """The advice kappa_t exp(-e_k) A_src,k of the source k with the smallest excess e_k, or none over the threshold.

    e_k is the excess of the mean |delta_k| of recent transitions, minus z standard errors over episodes, over the mean
    |delta_k| on the source's own task, or 0 if negative; the smaller |delta_k| breaks ties. On its own task the source
    is followed with the same exploration as in the transitions (`floor: exploring`), since the errors of a network are
    largest where its policy does not go.
    """

    def __init__(
        self, settings: DeltaSelectShaping, sources: Sequence[Network], floors: NDArray[np.float64], steps: int
    ) -> None:
        """floors: mean |delta| of each source on its own task (K, E), at the first E of EPSILONS."""
        super().__init__(settings, sources[0], None, steps)
        self._sources, self._floors = sources, floors
        self._floor = floors[:, 0]
        """(K,): mean |delta| on the own task of each source, at the exploration of the transitions in `_sums`."""
        self._floor_sums = np.zeros(len(sources))
        self._sums = np.zeros((3, len(sources)))
        """(3, K): exponentially weighted sums of |delta|, of its square, and of the number of transitions."""
        self._episodes = 0.0
        self._at, self.chosen = 0, 0
        """The best source; the chosen one, NONE where the best is over the threshold."""
        self._excess = np.zeros(1, np.float32)

    def observe(self, seen: Transitions, episodes: int, epsilon: float) -> None:
        """Use transitions made with this epsilon, the newest in episode number `episodes`, and choose again."""
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
        """Return e_k of the best source."""
        return float(self._excess[0])

    def _estimates(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return the mean |delta_k| and e_k of every source."""
        mean, square = self._sums[:2] / np.maximum(self._sums[2], 1e-300)
        sd = np.sqrt(np.maximum(square - mean**2, 0.0))
        episodes = max(1.0, min(self._episodes, self.settings.memory))
        return mean, np.maximum(mean - self.settings.z * sd / math.sqrt(episodes) - self._floor, 0.0)

    def follows(self) -> Follows:
        """Return the chosen source and its excess; nothing without one."""
        return Follows() if self.chosen == NONE else Follows(self.source, None, self._excess)

    def factor(self, observations: F32) -> F32:
        """Return exp(-e_k), (n,); 0 where no source is chosen."""
        value = 0.0 if self.chosen == NONE else math.exp(-self.excess)
        return np.full(len(observations), value, np.float32)

    def state(self) -> dict[str, Any]:
        """Return what training depends on, for a checkpoint."""
        numbers = super().state() | {"episodes": self._episodes, "chosen": self.chosen, "at": self._at}
        floors = {"floor": self._floor.copy(), "floor_sums": self._floor_sums.copy()}
        return numbers | floors | {"sums": self._sums.copy(), "excess": self._excess.copy()}

    def restore(self, state: Mapping[str, Any]) -> None:
        """Restore what `state` returned."""
        super().restore(state)
        self._sums[:] = state["sums"]
        self._floor, self._floor_sums = (np.array(state[name]) for name in ("floor", "floor_sums"))
        self._episodes = float(state["episodes"])
        self._at, self.chosen = int(state["at"]), int(state["chosen"])
        self.source = self._sources[self._at]
        self._excess[:] = state["excess"]


class ObservedTargets(TargetCache):
    """The targets of Q; when they are computed, the selection gets the new transitions."""

    def __init__(
        self, replay: Replay, target: Network, selection: Selection, gamma: float, now: Callable[[], tuple[int, float]]
    ) -> None:
        """now: returns the number of the episode, and its epsilon."""
        super().__init__(replay, target, selection, gamma)
        self._selection, self._now = selection, now

    def refresh(self, replay: Replay) -> None:
        """Compute stale targets, and choose the source again."""
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
