"""AdaStop: comparisons of agents group of seeds after group of seeds, with a bound on the family-wise error.

T. Mathieu et al., "AdaStop: adaptive statistical testing for sound comparisons of Deep RL agents", TMLR 2024
(arXiv 2306.10882). A group-sequential permutation test of the largest difference among the comparisons that are still
open, with step-down after each rejection. One thing differs: the paper permutes the scores of two agents as independent
samples, and here A and B are exchanged seed by seed, since agents share seeds. Where scores at a seed depend on each
other, independent permutations erred in up to 11 % of cases in place of 5 % (benchmarks/studies/sequential_seeds.py).
The authors' package `adastop` 0.1.3 is not used: it takes a quantile of the signed differences for a threshold of
absolute ones, and errs in 2 alpha of cases.
"""

from __future__ import annotations

import functools
import itertools
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

Pair = tuple[str, str]
"""Two entrants, A and B."""

State = Literal["better", "worse", "undecided", "open", "lost"]
"""A is better or worse than B; undecided after the last group; open: scores are missing; lost: a score is NaN."""

Whole = NDArray[np.float64]
"""Whole numbers, small enough that their sums are exact and do not depend on the order."""

PATHS = 10_000
"""Exchanges of seeds that stand for all, where there are more."""

BITS, MOST_BITS = 36, 42
"""Scores are compared as whole numbers: the largest of the first group has BITS bits, and none more than MOST_BITS."""


@dataclass(frozen=True)
class Design:
    """The groups of a sequential test."""

    group: int
    """Seeds of a group: N in the paper."""
    looks: int
    """Most groups, with a test after each: K in the paper."""
    alpha: float
    """The family-wise error: the probability of one wrong decision or more among all comparisons."""


@dataclass(frozen=True)
class Outcome:
    """What the test says of one comparison."""

    state: State
    looks: int
    """Groups of seeds that were tested, up to the decision."""


def decide(scores: Mapping[str, Sequence[float]], pairs: Sequence[Pair], design: Design) -> dict[Pair, Outcome]:
    """Return the outcome of each comparison, from each entrant's scores in the order of its seeds.

    Depends on the scores alone: those of a group count once all open comparisons have them, and what comes after a
    decision counts no more. After group k at most alpha k / K of the error is spent, as in the authors' package.
    """
    outcomes = {pair: Outcome("open", 0) for pair in pairs}
    numbers = _whole_numbers(scores, design.group)
    sums: dict[Pair, list[Whole]] = {pair: [] for pair in pairs}
    families: dict[tuple[Pair, ...], _Family] = {}
    for look in range(1, design.looks + 1):
        end = look * design.group
        undecided = [pair for pair in pairs if outcomes[pair].state == "open"]
        if not undecided or any(len(scores[name]) < end for pair in undecided for name in pair):
            break
        for pair in undecided:
            lost = any(math.isnan(score) for name in pair for score in scores[name][:end])
            outcomes[pair] = Outcome("lost" if lost else "open", look)
            sums[pair].append(_exchanged(numbers, pair, design, look) + (sums[pair][-1] if sums[pair] else 0.0))
        left = [pair for pair in undecided if outcomes[pair].state == "open"]
        while left:  # Algorithm 1: the largest difference first
            largest = max(left, key=lambda pair: abs(float(sums[pair][-1][0])))
            family = families.setdefault(tuple(left), _Family(tuple(left)))
            if abs(sums[largest][-1][0]) <= family.threshold(sums, design):
                break
            outcomes[largest] = Outcome("better" if sums[largest][-1][0] > 0 else "worse", look)
            left.remove(largest)
    last = {pair: found for pair, found in outcomes.items() if found.looks == design.looks and found.state == "open"}
    return outcomes | {pair: Outcome("undecided", design.looks) for pair in last}


@dataclass
class _Family:
    """Comparisons that are open together, and the error that they have spent up to a look."""

    pairs: tuple[Pair, ...]
    looks: int = 0
    spent: int = 0
    """Exchanges whose largest difference has exceeded the threshold of a look."""
    alive: NDArray[np.bool_] | None = None
    """The others, which alone have a part in later thresholds."""

    def threshold(self, sums: Mapping[Pair, Sequence[Whole]], design: Design) -> float:
        """Return what the largest difference must exceed after the last look.

        sums: comparison to its difference of sums after each look, by exchange; the first is what was observed.
        """
        threshold = math.inf
        for look in range(self.looks, len(sums[self.pairs[0]])):
            sizes = np.maximum.reduce([np.abs(sums[pair][look]) for pair in self.pairs])
            alive = np.ones(len(sizes), dtype=bool) if self.alive is None else self.alive
            allowed = math.floor(design.alpha * (look + 1) / design.looks * len(sizes) + 1e-9) - self.spent
            there = sizes[alive]
            threshold = float(np.partition(there, len(there) - 1 - allowed)[len(there) - 1 - allowed])
            over = alive & (sizes > threshold)
            self.spent, self.alive, self.looks = self.spent + int(over.sum()), alive & ~over, look + 1
        return threshold


def _exchanged(numbers: Mapping[str, Whole], pair: Pair, design: Design, look: int) -> Whole:
    """Return the difference of the sums of group `look` under each exchange of A and B at some of its seeds."""
    part = slice((look - 1) * design.group, look * design.group)
    result: Whole = _signs(design.group, design.looks)[look - 1] @ (numbers[pair[0]][part] - numbers[pair[1]][part])
    return result


@functools.lru_cache(maxsize=8)
def _signs(group: int, looks: int) -> list[Whole]:
    """Return for each group of seeds its exchanges as signs, (exchanges, group); the first exchanges nothing.

    All of them where all groups together have at most PATHS; else a fixed sample, in which every exchange within a
    group occurs equally often if there are at most PATHS.
    """
    count = 2**group
    rng = np.random.RandomState(0)  # its stream is the same in every version of numpy
    if count > PATHS:
        drawn = np.where(rng.random_sample((looks, PATHS, group)) < 0.5, 1.0, -1.0)
        drawn[:, 0] = 1.0
        return list(drawn)
    every = np.array(list(itertools.product([1.0, -1.0], repeat=group)))
    if count**looks <= PATHS:
        return [every[number] for number in np.indices((count,) * looks).reshape(looks, -1)]
    rest = np.tile(np.arange(count), math.ceil(PATHS / count))[1:]
    return [every[np.concatenate([[0], rng.permutation(rest)])] for _ in range(looks)]


def _whole_numbers(scores: Mapping[str, Sequence[float]], group: int) -> dict[str, Whole]:
    """Return scores as whole numbers, relative to the largest of the first group; NaN as 0."""
    first = [abs(score) for values in scores.values() for score in values[:group] if math.isfinite(score)]
    shift = BITS - math.frexp(max(first, default=0.0))[1]
    most = 2.0**MOST_BITS

    def whole(values: Sequence[float]) -> Whole:
        scaled = np.ldexp(np.nan_to_num(np.asarray(values, np.float64)), shift)
        result: Whole = np.rint(np.clip(scaled, -most, most))
        return result

    return {name: whole(values) for name, values in scores.items()}
