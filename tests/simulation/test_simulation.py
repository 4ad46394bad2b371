"""The real driver in virtual time keeps its promises under any faults, and the simulation sees it where it does not."""

from __future__ import annotations

import logging
from collections import Counter
from collections.abc import Iterator

import pytest

from tests.simulation import crash_points
from tests.simulation.mutants import MUTANTS, Mutant
from tests.simulation.simulate import SHARES, simulate

SEEDS = [
    pytest.param(range(start, start + 125), marks=[pytest.mark.slow] if start else [], id=f"{start}-{start + 124}")
    for start in range(0, 1000, 125)
]
"""A thousand, in parts that run beside each other; the first of them at every change."""


@pytest.fixture(autouse=True)
def _unlogged() -> Iterator[None]:
    """Log nothing: the tracebacks of thousands of faults take a part of the time."""
    logging.disable()
    yield
    logging.disable(logging.NOTSET)


@pytest.mark.parametrize("seeds", SEEDS)
def test_a_thousand_seeds_break_no_promise(seeds: range) -> None:
    injected: Counter[str] = Counter()
    for seed in seeds:
        run = simulate(seed)
        assert run.violations == [], f"python -m tests.simulation --seed {seed}"
        injected += run.injected
    assert set(SHARES) <= set(injected), "a fault that never strikes tests nothing"


@pytest.mark.slow  # of the simulation itself
@pytest.mark.parametrize("mutant", MUTANTS, ids=lambda mutant: mutant.what)
def test_a_mistake_in_the_code_is_found(mutant: Mutant) -> None:
    assert mutant.caught_by(range(100)) is not None


def test_a_sweep_goes_on_from_every_crash_point() -> None:
    tried = list(crash_points.every())
    assert [(which, wrong) for which, wrong in tried if wrong] == []
    assert len(tried) > 200
