"""Ranking sources for a target: which of them to follow, by their delta along their own paths.

A target episode is played by one source and tells of all of them. It is always the source that looks best so far that
plays the next one: where nothing was seen delta counts as 0, so a source is believed until its own path refutes it, and
the episodes go where the answer is decided. Every 20th is played at random, for what to hold the sources against.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, Protocol

from trainables.source_ranking.path_value import Following

Z = 1.96
"""Standard errors to either side of an interval."""
RANDOM_EVERY = 20
"""One in so many episodes is played at random, the first included."""
FLOOR_EPISODES = 10
"""Fewest episodes for a source's own floor."""
EVEN = 0.5
"""Share of the episodes that the sources play in turn; the rest is played by the best so far."""
KEEP = 0.75
"""Share of its promised advantage over acting at random that a source must keep to be recommended."""


@dataclass(frozen=True)
class Ranked:
    """One source's place."""

    source: int
    """Its number in the order given."""
    episodes: int
    """Target episodes that it played."""
    target: Following
    """On the target."""
    floor: Following
    """On its own task, from as many episodes of it: what its errors alone come to."""
    kept: tuple[float, float, float]
    """Share of its promised advantage over acting at random that it keeps on the target: estimate, low, high."""

    @property
    def low(self) -> float:
        """The lower end of the interval of the discounted return of following it."""
        return self.target.value - Z * self.target.se

    @property
    def high(self) -> float:
        """The upper end."""
        return self.target.value + Z * self.target.se

    @property
    def similar(self) -> bool:
        """Whether what it misses of its promise is not clearly more than on its own task."""
        gap = self.floor.path_delta - self.target.path_delta
        return gap <= Z * math.hypot(self.floor.se, self.target.se)

    @property
    def verdict(self) -> Literal["similar", "useful", "no"]:
        """similar: within its own floor; useful: not, but keeps KEEP of its promise for certain; no: neither."""
        if self.kept[1] < KEEP:
            return "no"
        return "similar" if self.similar else "useful"


@dataclass(frozen=True)
class Ranking:
    """Sources from best to worst by the lower end of their value's interval: what is not refuted is not yet proven."""

    ranked: tuple[Ranked, ...]
    random_return: float
    """Discounted return of acting at random."""
    steps: int
    """Target steps taken."""

    @property
    def recommended(self) -> Ranked | None:
        """The best source, None where it does not keep enough of its promise."""
        best = self.ranked[0]
        return None if best.verdict == "no" else best


class Bench(Protocol):
    """A target with the sources that are tried on it."""

    @property
    def steps(self) -> int:
        """Target steps taken."""

    def play(self, source: int | None) -> float:
        """Play one target episode, by a source or at random, and take it in; its discounted return."""

    def values(self) -> Sequence[float]:
        """The value of following each source as far as is known, the higher the sooner it is tried."""

    def estimates(self) -> Sequence[Following]:
        """What is known of each source in the end."""

    def floors(self, episodes: Sequence[int]) -> Sequence[Following]:
        """The same on each source's own task, from so many episodes of it."""


def rank(bench: Bench, count: int, episodes: int) -> Ranking:
    """Rank `count` sources by `episodes` target episodes."""
    played, random = [0] * count, []
    for episode in range(episodes):
        if episode % RANDOM_EVERY == 0:
            random.append(bench.play(None))
            continue
        next_source = _next(bench, played, even=sum(played) < EVEN * episodes)
        bench.play(next_source)
        played[next_source] += 1
    floors = bench.floors([max(number, FLOOR_EPISODES) for number in played])
    worth = sum(random) / len(random)
    found = [
        Ranked(k, played[k], target, floor, _kept(target, worth))
        for k, (target, floor) in enumerate(zip(bench.estimates(), floors, strict=True))
    ]
    order = sorted(found, key=lambda ranked: (-ranked.low, ranked.source))
    return Ranking(tuple(order), worth, bench.steps)


def _next(bench: Bench, played: Sequence[int], even: bool) -> int:
    """The source that plays: the one that has played least, or the best so far; the first of equals."""
    values = [-number for number in played] if even else bench.values()
    return max(range(len(played)), key=lambda k: (values[k], -k))


def _kept(target: Following, random_return: float) -> tuple[float, float, float]:
    promised = max(target.promise - random_return, 1e-9)
    half = Z * target.se
    low, mid, high = ((target.value + step - random_return) / promised for step in (-half, 0.0, half))
    return mid, low, high
