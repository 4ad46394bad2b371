"""`seeds: auto` in a search space: how it is written, what it stands for, and what it cannot be combined with."""

from __future__ import annotations

from typing import Any

import pytest
from conftest import SPACE

from search_spaces.loading import parse
from search_spaces.narrow import narrow
from search_spaces.search_space import SearchSpace
from trainables.errors import InputError


def space(**changes: Any) -> SearchSpace:
    return parse("small", SPACE | {"seeds": "auto"} | changes)


def test_auto_stands_for_a_budget_and_a_test() -> None:
    asked = space()
    assert asked == space(seeds={"auto": {}}) == space(seeds=30, sequential={})
    assert asked == parse("small", asked.to_json())
    assert asked.seeds == tuple(range(30))
    assert asked.sequential is not None
    assert (asked.sequential.group, asked.sequential.alpha) == (5, 0.05)
    written = space(seeds={"auto": {"group": 4, "max": 12, "alpha": 0.1}})
    assert written.sequential is not None
    assert (len(written.seeds), written.sequential.group, written.sequential.alpha) == (12, 4, 0.1)
    assert parse("small", SPACE).sequential is None


def test_a_number_of_seeds_replaces_auto_and_auto_keeps_what_the_space_says() -> None:
    written = space(seeds={"auto": {"group": 4, "max": 12}})
    assert narrow(parse("small", SPACE), seeds="auto") == space()
    assert narrow(written, seeds="auto") == written
    assert narrow(written, agents=["q_learning", "delta_gate"]).sequential == written.sequential
    assert narrow(written, seeds=3) == narrow(parse("small", SPACE), seeds=3)


def test_the_source_does_not_depend_on_how_many_seeds_the_test_takes() -> None:
    scenario: dict[str, Any] = SPACE["scenarios"][0]  # type: ignore[assignment,index]
    picked = [space(scenarios=[scenario | {"source": scenario["source"] | {"pick": pick}}]) for pick in ("each", 2)]
    for asked in picked:
        assert asked.source_seeds(asked.scenarios[0].source) == (0, 1, 2, 3, 4)
    assert space().source_seeds(space().scenarios[0].source) == tuple(range(30)), "each seed has a source of its own"
    with pytest.raises(InputError, match=r"source\.pick must be one of the seeds \(got 7\)"):
        space(scenarios=[scenario | {"source": scenario["source"] | {"pick": 7}}])


RANGE = {"q_learning": {}, "ppr": {"nu": {"low": 0.5, "high": 0.9}}}
REFUSED: dict[str, tuple[dict[str, Any], str]] = {
    "confirm": ({"confirm": {"seeds": 3}}, "seeds: auto and confirm cannot be combined"),
    "early stopping": ({"search": {"scheduler": {"method": "asha"}}}, r"take out search\.scheduler"),
    "a search": ({"agents": RANGE, "search": {"method": "optuna"}}, r"ppr\.nu is a range to search"),
    "agents that do not meet": ({"agents": {"policy_reuse": {}}}, "none of policy_reuse builds on another"),
    "two tests": ({"sequential": {"group": 3}}, "leave one out"),
}


@pytest.mark.parametrize(("changes", "message"), REFUSED.values(), ids=REFUSED)
def test_what_it_cannot_be_combined_with_is_refused_in_a_sentence(changes: dict[str, Any], message: str) -> None:
    with pytest.raises(InputError, match=message):
        space(**changes)
