"""AdaStop: comparisons of agents group of seeds after group of seeds, with a bound on the family-wise error.

T. Mathieu et al., "AdaStop: adaptive statistical testing for sound comparisons of Deep RL agents", TMLR 2024
(arXiv 2306.10882). A group-sequential permutation test of the largest difference among the comparisons that are still
open, with step-down after each rejection. The authors' package `adastop` 0.1.3 takes a quantile of the signed
differences for a threshold of absolute ones, so that it errs in 2 alpha of cases; hence the test is written here.
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
"""Permutations that stand for all, where there are more."""

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
    for look in range(1, design.looks + 1):
        end = look * design.group
        undecided = [pair for pair in pairs if outcomes[pair].state == "open"]
        if not undecided or any(len(scores[name]) < end for pair in undecided for name in pair):
            break
        for pair in undecided:
            lost = any(math.isnan(score) for name in pair for score in scores[name][:end])
            outcomes[pair] = Outcome("lost" if lost else "open", look)
            sums[pair].append(_permuted(numbers, pair, design, look) + (sums[pair][-1] if sums[pair] else 0.0))
        left = {pair: np.stack(sums[pair]) for pair in undecided if outcomes[pair].state == "open"}
        for pair in _rejected(left, design):
            outcomes[pair] = Outcome("better" if sums[pair][-1][0] > 0 else "worse", look)
    last = {pair: found for pair, found in outcomes.items() if found.looks == design.looks and found.state == "open"}
    return outcomes | {pair: Outcome("undecided", design.looks) for pair in last}


def _rejected(sums: Mapping[Pair, Whole], design: Design) -> list[Pair]:
    """Return the comparisons that are decided after the last look, the largest difference first (Algorithm 1).

    sums: comparison to the difference of the sums of scores so far, (looks, permutations); permutation 0 is what was
    observed.
    """
    left = {pair: np.abs(each) for pair, each in sums.items()}
    rejected = []
    while left:
        largest = max(left, key=lambda pair: float(left[pair][-1, 0]))
        if left[largest][-1, 0] <= _threshold(np.maximum.reduce(list(left.values())), design):
            break
        rejected.append(largest)
        del left[largest]
    return rejected


def _threshold(largest: Whole, design: Design) -> float:
    """Return what the largest difference must exceed after the last look of `largest` (looks, permutations).

    Permutations that exceed the threshold of a look count as its error, and have no part in later ones.
    """
    alive = np.ones(largest.shape[1], dtype=bool)
    spent, threshold = 0, 0.0
    for look, sizes in enumerate(largest, start=1):
        allowed = math.floor(design.alpha * look / design.looks * len(alive) + 1e-9) - spent
        there = sizes[alive]
        threshold = float(np.partition(there, len(there) - 1 - allowed)[len(there) - 1 - allowed])
        over = alive & (sizes > threshold)
        spent += int(over.sum())
        alive &= ~over
    return threshold


def _permuted(numbers: Mapping[str, Whole], pair: Pair, design: Design, look: int) -> Whole:
    """Return the difference of the sums of group `look` under each permutation of its scores."""
    part = slice((look - 1) * design.group, look * design.group)
    result: Whole = _signs(design.group, design.looks)[look - 1] @ np.concatenate(
        [numbers[name][part] for name in pair]
    )
    return result


@functools.lru_cache(maxsize=8)
def _signs(group: int, looks: int) -> list[Whole]:
    """Return for each group of seeds its permutations as signs, (permutations, 2 group); the first is the identity.

    All of them where all groups together have at most PATHS; else a fixed sample, in which every permutation of a group
    occurs equally often if there are at most PATHS.
    """
    count = math.comb(2 * group, group)
    rng = np.random.RandomState(0)  # its stream is the same in every version of numpy
    if count > PATHS:
        orders = rng.random_sample((looks, PATHS, 2 * group)).argsort(axis=2, kind="stable")
        orders[:, 0] = np.arange(2 * group)
        return [np.where(order < group, 1, -1).astype(np.float64) for order in orders]
    every = np.full((count, 2 * group), -1.0)
    for row, chosen in zip(every, itertools.combinations(range(2 * group), group), strict=True):
        row[list(chosen)] = 1
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
        return np.rint(np.clip(scaled, -most, most))

    return {name: whole(values) for name, values in scores.items()}
