"""The real driver in virtual time keeps its promises under any faults, and the simulation sees it where it does not."""

from __future__ import annotations

from collections import Counter

import pytest

from tests.simulation import crash_points
from tests.simulation.mutants import MUTANTS, Mutant
from tests.simulation.simulate import SHARES, simulate

SEEDS = 1000


def test_a_thousand_seeds_break_no_promise() -> None:
    injected: Counter[str] = Counter()
    for seed in range(SEEDS):
        run = simulate(seed)
        assert run.violations == [], f"python -m tests.simulation --seed {seed}"
        injected += run.injected
    assert {fault for fault in SHARES if injected[fault] < 5} == set(), "a fault that never strikes tests nothing"


@pytest.mark.parametrize("mutant", MUTANTS, ids=lambda mutant: mutant.what)
def test_a_mistake_in_the_code_is_found(mutant: Mutant) -> None:
    assert mutant.caught_by(range(100)) is not None


def test_a_sweep_goes_on_from_every_crash_point() -> None:
    tried = list(crash_points.every())
    assert [(which, wrong) for which, wrong in tried if wrong] == []
    assert len(tried) > 200
