"""The spaces of the studies: each loads, and those that the reproduction reads have the names that it looks for."""

from __future__ import annotations

from pathlib import Path

import pytest

from benchmarks import studies
from benchmarks.reproduction.claims import SHARES
from benchmarks.reproduction.curves import BASELINES, EXPLORATION, FRACTIONS, STUDIES
from benchmarks.reproduction.others import ARMS, EXPLORING
from search_spaces.loading import load

FOLDER = Path(studies.__file__).parent


@pytest.mark.parametrize("path", sorted(FOLDER.glob("*.yaml")), ids=lambda path: path.stem)
def test_a_studys_space_loads(path: Path) -> None:
    space = load(str(path))
    assert space.name.startswith((*STUDIES, "safe-start"))
    assert space.scenarios


def test_the_reproduction_finds_the_agents_and_shares_that_it_shows() -> None:
    names = ("baselines", "baselines_acrobot", "baselines_lunar_lander", "exploration", "figure4")
    *beside, exploring, fractions = (load(str(FOLDER / f"{name}.yaml")) for name in names)
    assert (tuple(space.name for space in beside), fractions.name) == (BASELINES, FRACTIONS)
    assert exploring.name == EXPLORATION
    assert {name: value.values[0] for name, value in exploring.agents["dqn"].items()} == dict(EXPLORING.settings)
    assert all({arm.agent for arm in ARMS} == set(space.agents) for space in beside[:2])
    assert set(beside[2].agents) < {arm.agent for arm in ARMS}
    assert tuple(fractions.agents["es"]["advice_fraction"].values) == SHARES
