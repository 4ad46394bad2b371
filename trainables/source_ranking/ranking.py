"""The ranking of sources for a target, by their delta along their own paths.

One source plays each target episode, but all of them learn from it. The source that is best so far plays the next one:
delta counts as 0 where nothing was observed, so a source is trusted until its own path refutes it, and the episodes are
spent where they decide the ranking. Every 20th episode is random, as a reference for the sources.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, Protocol

from trainables.source_ranking.path_value import Following

Z = 1.96
"""Half-width of an interval in standard errors."""
RANDOM_EVERY = 20
"""One episode in this many is random, the first included."""
FLOOR_EPISODES = 10
"""Least number of episodes for the noise floor of a source."""
EVEN = 0.5
"""Share of the episodes that the sources play in turn; the best so far plays the rest."""
KEEP = 0.75
"""Share of its predicted advantage over acting at random that a source must keep to be recommended."""


@dataclass(frozen=True)
class Ranked:
    """The estimates for one ranked source."""

    source: int
    """Its number in the order given."""
    episodes: int
    """Target episodes that it played."""
    target: Following
    """The estimate on the target."""
    floor: Following
    """The estimate on its own task, from as many episodes: the effect of its errors alone."""
    kept: tuple[float, float, float]
    """Retained share of its predicted advantage over acting at random: estimate, low, high."""

    @property
    def low(self) -> float:
        """The lower end of the interval of the return of following it."""
        return self.target.value - Z * self.target.se

    @property
    def high(self) -> float:
        """The upper end of this interval."""
        return self.target.value + Z * self.target.se

    @property
    def similar(self) -> bool:
        """Whether its path delta is not significantly worse than on its own task."""
        gap = self.floor.path_delta - self.target.path_delta
        return gap <= Z * math.hypot(self.floor.se, self.target.se)

    @property
    def verdict(self) -> Literal["similar", "useful", "no"]:
        """The verdict; similar: within its noise floor; useful: not, but it surely keeps KEEP of its advantage; no."""
        if self.kept[1] < KEEP:
            return "no"
        return "similar" if self.similar else "useful"


@dataclass(frozen=True)
class Ranking:
    """Sources from best to worst, by the lower end of the interval of their value, which needs evidence."""

    ranked: tuple[Ranked, ...]
    random_return: float
    """Discounted return of acting at random."""
    steps: int
    """Steps taken on the target."""

    @property
    def recommended(self) -> Ranked | None:
        """The best source, or None where it does not keep enough of its predicted advantage."""
        best = self.ranked[0]
        return None if best.verdict == "no" else best


class SourceComparison(Protocol):
    """Evaluates candidate sources on one target."""

    @property
    def steps(self) -> int:
        """Target steps taken."""

    def close(self) -> None:
        """Close what it holds open."""

    def play(self, source: int | None) -> float:
        """Play a target episode, by a source or at random, and learn from it; return its discounted return."""

    def values(self) -> Sequence[float]:
        """Return the present (optimistic) value of following each source; the highest is tried next."""

    def estimates(self) -> Sequence[Following]:
        """Return the final estimate for each source."""

    def floors(self, episodes: Sequence[int]) -> Sequence[Following]:
        """Return the same on each source's own task, from so many episodes there."""


def rank(comparison: SourceComparison, count: int, episodes: int) -> Ranking:
    """Rank `count` sources by `episodes` target episodes."""
    played, random = [0] * count, []
    for episode in range(episodes):
        if episode % RANDOM_EVERY == 0:
            random.append(comparison.play(None))
            continue
        next_source = _next(comparison, played, even=sum(played) < EVEN * episodes)
        comparison.play(next_source)
        played[next_source] += 1
    floors = comparison.floors([max(number, FLOOR_EPISODES) for number in played])
    worth = sum(random) / len(random)
    found = [
        Ranked(k, played[k], target, floor, _kept(target, worth))
        for k, (target, floor) in enumerate(zip(comparison.estimates(), floors, strict=True))
    ]
    order = sorted(found, key=lambda ranked: (-ranked.low, ranked.source))
    return Ranking(tuple(order), worth, comparison.steps)


def _next(comparison: SourceComparison, played: Sequence[int], even: bool) -> int:
    """Return the source that plays next: the one with the fewest episodes, or the best so far; the first of equals."""
    values = [-number for number in played] if even else comparison.values()
    return max(range(len(played)), key=lambda k: (values[k], -k))


def _kept(target: Following, random_return: float) -> tuple[float, float, float]:
    promised = max(target.promise - random_return, 1e-9)
    half = Z * target.se
    low, mid, high = ((target.value + step - random_return) / promised for step in (-half, 0.0, half))
    return mid, low, high
