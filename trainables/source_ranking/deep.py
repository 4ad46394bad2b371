"""Source networks on a deep target, whose model is unknown: path deltas are measured in whole episodes."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from trainables.delta.noise_floor import Episode, episode_of, self_delta
from trainables.delta.sample import delta_samples
from trainables.networks.network import Network
from trainables.numerics.rng import stream
from trainables.source_ranking.path_value import Following
from trainables.tasks.registry import parse_task
from trainables.tasks.rollout import Rollout

UCB = 1.0
"""Standard errors added to a source's value, which favours sources with few episodes."""


class DeepComparison:
    """The comparison of source networks on a deep target."""

    def __init__(self, target: str, sources: Sequence[tuple[str, Network]], gamma: float, seed: int) -> None:
        self._rollout = Rollout(parse_task(target), stream(seed, "calibration", target))
        self._sources, self._gamma, self._seed = sources, gamma, seed
        self._episodes: list[list[Episode]] = [[] for _ in sources]
        self._squares = np.zeros((len(sources), 2))
        """(K, 2): sum of delta^2 and number of samples, over the transitions of all episodes."""
        self.steps = 0

    def play(self, source: int | None) -> float:
        """Play a target episode; return its discounted return."""
        seen = self._rollout.episode(None if source is None else self._sources[source][1])
        self.steps += len(seen.rewards)
        for k, (_, network) in enumerate(self._sources):
            samples = delta_samples(network, seen, self._gamma).astype(np.float64)
            self._squares[k] += float(samples @ samples), len(samples)
        if source is not None:
            self._episodes[source].append(episode_of(self._sources[source][1], seen, self._gamma))
        return float(self._gamma ** np.arange(len(seen.rewards)) @ seen.rewards.astype(np.float64))

    def close(self) -> None:
        """Close the target's environment."""
        self._rollout.close()

    def values(self) -> list[float]:
        """Return the upper bound of each source's value from its episodes; infinity without any."""
        sd = _pooled_sd(self._episodes)
        return [
            _mean([e.promise + e.path_delta for e in episodes]) + UCB * sd / math.sqrt(len(episodes))
            if episodes
            else math.inf
            for episodes in self._episodes
        ]

    def estimates(self) -> list[Following]:
        """Return the estimate for each source, from its episodes and all transitions."""
        sd = _pooled_sd(self._episodes, unknown=math.inf)
        sizes = np.sqrt(self._squares[:, 0] / np.maximum(self._squares[:, 1], 1))
        return [_following(episodes, sd, float(size)) for episodes, size in zip(self._episodes, sizes, strict=True)]

    def floors(self, episodes: Sequence[int]) -> list[Following]:
        """Return the estimate for each source followed on its own task."""
        found = []
        for (task, network), number in zip(self._sources, episodes, strict=True):
            own = self_delta(network, task, self._gamma, self._seed, number)
            found.append(_following(list(own.episodes), _pooled_sd([list(own.episodes)]), own.root_mean_square))
        return found


def _mean(values: Sequence[float]) -> float:
    return math.fsum(values) / len(values)


def _pooled_sd(groups: Sequence[Sequence[Episode]], unknown: float = 0.0) -> float:
    """Return the standard deviation of an episode's value around its source's mean, pooled over all sources.

    unknown: the result where no source has two episodes.
    """
    squares, freedom = 0.0, 0
    for group in groups:
        values = [episode.promise + episode.path_delta for episode in group]
        if len(values) > 1:
            squares += float(np.var(values)) * len(values)
            freedom += len(values) - 1
    return math.sqrt(squares / freedom) if freedom else unknown


def _following(episodes: Sequence[Episode], sd: float, size: float) -> Following:
    if not episodes:
        return Following(0.0, -math.inf, math.inf, size, 1.0)
    promise = _mean([episode.promise for episode in episodes])
    path = _mean([episode.path_delta for episode in episodes])
    return Following(promise, path, sd / math.sqrt(len(episodes)), size, 0.0)
