"""The spaces of the studies: each loads, and those that the reproduction reads have the names that it looks for."""

from __future__ import annotations

from pathlib import Path

import pytest

from benchmarks import studies
from benchmarks.reproduction.claims import SHARES
from benchmarks.reproduction.curves import BASELINES, FRACTIONS, STUDIES
from benchmarks.reproduction.others import ARMS
from search_spaces.loading import load

FOLDER = Path(studies.__file__).parent


@pytest.mark.parametrize("path", sorted(FOLDER.glob("*.yaml")), ids=lambda path: path.stem)
def test_a_studys_space_loads(path: Path) -> None:
    space = load(str(path))
    assert space.name.startswith((*STUDIES, "safe-start"))
    assert space.scenarios


def test_the_reproduction_finds_the_agents_and_shares_that_it_shows() -> None:
    beside, fractions = (load(str(FOLDER / name)) for name in ("baselines.yaml", "figure4.yaml"))
    assert (beside.name, fractions.name) == (BASELINES, FRACTIONS)
    assert {arm.agent for arm in ARMS} == set(beside.agents) - {"dqn"}
    assert tuple(fractions.agents["es"]["advice_fraction"].values) == SHARES
