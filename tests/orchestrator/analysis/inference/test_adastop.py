"""AdaStop: against its definition in plain Python, the classical permutation test, and the error that it promises."""

from __future__ import annotations

import itertools
import math

import hypothesis.strategies as st
import numpy as np
import pytest
from hypothesis import given, settings
from scipy import stats

from orchestrator.analysis.inference import adastop
from orchestrator.analysis.inference.adastop import Design, Outcome, decide

Scores = dict[str, list[float]]
PAIRS = [("b", "a"), ("c", "a"), ("c", "b")]


def by_definition(scores: Scores, pairs: list[tuple[str, str]], design: Design) -> dict[tuple[str, str], Outcome]:
    """Algorithm 1 of the paper, with every exchange of two agents at every seed written out."""
    n, left = design.group, list(pairs)
    found = {pair: Outcome("undecided", design.looks) for pair in pairs}
    signs = list(itertools.product([1, -1], repeat=n))
    paths = list(itertools.product(signs, repeat=design.looks))

    def statistic(path: tuple[tuple[int, ...], ...], among: list[tuple[str, str]], look: int) -> float:
        return max(abs(sum(difference(path[at], pair, at) for at in range(look))) for pair in among)

    def difference(chosen: tuple[int, ...], pair: tuple[str, str], at: int) -> float:
        first, second = (scores[name][at * n : (at + 1) * n] for name in pair)
        return sum(sign * (a - b) for sign, a, b in zip(chosen, first, second, strict=True))

    def threshold(among: list[tuple[str, str]], last: int) -> float:
        alive, spent, bound = paths, 0, 0.0
        for look in range(1, last + 1):
            values = {path: statistic(path, among, look) for path in alive}
            allowed = math.floor(design.alpha * look / design.looks * len(paths) + 1e-9) - spent
            bound = min(v for v in values.values() if sum(w > v for w in values.values()) <= allowed)
            spent += sum(value > bound for value in values.values())
            alive = [path for path in alive if values[path] <= bound]
        return bound

    for look in range(1, design.looks + 1):
        while left:
            sizes = {pair: abs(sum(difference(signs[0], pair, at) for at in range(look))) for pair in left}
            largest = max(left, key=lambda pair: sizes[pair])
            if sizes[largest] <= threshold(left, look):
                break
            first, second = (sum(scores[name][: look * n]) for name in largest)
            found[largest] = Outcome("better" if first > second else "worse", look)
            left.remove(largest)
    return found


numbers = st.lists(st.integers(-8, 8).map(float), min_size=6, max_size=6)


@settings(max_examples=25)
@given(numbers, numbers, st.integers(-20, 20))
def test_it_is_algorithm_1_with_every_exchange(a: list[float], b: list[float], shift: int) -> None:
    scores = {"a": a, "b": b, "c": [score + shift for score in b[::-1]]}
    for alpha in (0.2, 0.7):
        design = Design(group=3, looks=2, alpha=alpha)
        assert decide(scores, PAIRS, design) == by_definition(scores, PAIRS, design)


@pytest.mark.parametrize("seed", range(12))
def test_one_comparison_of_one_group_is_the_classical_paired_permutation_test(seed: int) -> None:
    rng = np.random.default_rng(seed)
    a, b = rng.normal(size=8), rng.normal(1.3, size=8)
    test = stats.permutation_test(
        (b, a), lambda x, y, axis: (x - y).mean(axis=axis), permutation_type="samples", n_resamples=np.inf
    )
    for alpha in (0.01, 0.05, 0.1, 0.3):
        found = decide({"a": list(a), "b": list(b)}, [("b", "a")], Design(8, 1, alpha))
        assert (found["b", "a"].state != "undecided") == (test.pvalue <= alpha)


def decided_wrongly(rng: np.random.Generator, shift: float, dependent: bool) -> bool:
    """Whether b against c, which are equal, is decided; a is worse by `shift`.

    dependent: the three change places at every seed, so that where one is good the others are not.
    """
    table = rng.exponential(size=(3, 12))
    if dependent:
        table = rng.permuted(table * 0.1 + np.array([[0.0], [1.0], [3.0]]), axis=0)
    table[0] -= shift
    found = decide(dict(zip("abc", table.tolist(), strict=True)), PAIRS, Design(4, 3, 0.1))
    null = PAIRS if shift == 0 else PAIRS[2:]
    return any(found[pair].state in ("better", "worse") for pair in null)


@pytest.mark.parametrize("dependent", [False, True])
@pytest.mark.parametrize("shift", [0.0, 2.0])
def test_the_family_wise_error_is_kept_whether_all_agents_are_equal_or_some(shift: float, dependent: bool) -> None:
    rng = np.random.default_rng(0)
    wrong = sum(decided_wrongly(rng, shift, dependent) for _ in range(300))
    assert wrong <= stats.binom.ppf(0.999, 300, 0.1)


def test_a_clear_difference_is_decided_by_the_second_group_and_more_scores_change_nothing() -> None:
    scores: Scores = {"a": [float(n) for n in range(10)], "b": [10.0 + n for n in range(10)]}
    design = Design(5, 6, 0.05)
    assert decide(scores, [("a", "b")], design) == {("a", "b"): Outcome("worse", 2)}
    assert decide(scores, [("b", "a")], design) == {("b", "a"): Outcome("better", 2)}
    longer = {name: [*values, *([100.0] * 20)] for name, values in scores.items()}
    assert decide(longer, [("a", "b")], design) == {("a", "b"): Outcome("worse", 2)}


def test_missing_scores_leave_a_comparison_open_and_a_failed_one_ends_it() -> None:
    design = Design(2, 3, 0.05)
    assert decide({"a": [1.0], "b": [2.0, 3.0]}, [("a", "b")], design) == {("a", "b"): Outcome("open", 0)}
    assert decide({"a": [1.0, 2], "b": [2.0, 1]}, [("a", "b")], design) == {("a", "b"): Outcome("open", 1)}
    assert decide({"a": [1.0, math.nan], "b": [2.0, 3]}, [("a", "b")], design) == {("a", "b"): Outcome("lost", 1)}
    equal = {"a": [1.0] * 6, "b": [1.0] * 6}
    assert decide(equal, [("a", "b")], design) == {("a", "b"): Outcome("undecided", 3)}
    assert decide({}, [], design) == {}


@pytest.mark.parametrize("scale", [1e-300, 1e-6, 1.0, 1e6, 1e300])
def test_neither_the_unit_of_the_scores_nor_a_constant_decides(scale: float) -> None:
    rng = np.random.default_rng(3)
    scores = {"a": list(rng.normal(size=20)), "b": list(rng.normal(1.1, size=20))}
    design = Design(5, 4, 0.05)
    plain = decide(scores, [("b", "a")], design)
    assert plain["b", "a"].state == "better"
    assert decide({k: [scale * v for v in values] for k, values in scores.items()}, [("b", "a")], design) == plain
    assert decide({k: [v + 50 for v in values] for k, values in scores.items()}, [("b", "a")], design) == plain


@pytest.mark.parametrize(("group", "looks"), [(5, 6), (15, 2), (8, 3)])
def test_the_sample_of_exchanges_is_fixed_and_even(group: int, looks: int) -> None:
    adastop._signs.cache_clear()
    signs = adastop._signs(group, looks)
    adastop._signs.cache_clear()
    assert all((a == b).all() for a, b in zip(signs, adastop._signs(group, looks), strict=True))
    for one in signs:
        assert (one[0] == 1).all(), "the first is what was observed"
        if 2**group <= adastop.PATHS:
            counts = np.unique(one, axis=0, return_counts=True)[1]
            assert len(counts) == 2**group
            assert len(set(counts)) == 1
