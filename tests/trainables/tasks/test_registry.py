"""A task's name says everything about it, and a wrong one is answered with a sentence that helps."""

from __future__ import annotations

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from trainables.errors import InputError
from trainables.tasks.builtin.windy_gridworld import WINDS
from trainables.tasks.make import make_env
from trainables.tasks.registry import families, parse_task

cells = st.tuples(st.integers(0, 19), st.integers(0, 19))
winds = st.one_of(st.sampled_from(sorted(WINDS.values())), st.tuples(*[st.integers(-19, 19)] * 20))
demand_means = st.floats(1e-6, 50, allow_nan=False)


def _text(values: tuple[int, ...]) -> str:
    return "[" + ",".join(map(str, values)) + "]"


@settings(deadline=None)
@given(winds, cells, cells, st.permutations(["wind", "start", "goal"]))
def test_a_gridworld_is_found_again_by_its_name(wind, start, goal, order) -> None:
    if start == goal:
        return
    context = {"wind": wind, "start": start, "goal": goal}
    task = parse_task("windy_gridworld:" + ",".join(f"{key}={_text(context[key])}" for key in order))
    assert task.context == context
    assert parse_task(task.name).name == task.name
    assert parse_task(task.name).context == context


@settings(deadline=None)
@given(winds, cells, cells)
def test_only_features_off_their_default_are_in_the_name(wind, start, goal) -> None:
    if start == goal:
        return
    given_values = {"wind": wind, "start": start, "goal": goal}
    name = parse_task("windy_gridworld:" + ",".join(f"{k}={_text(v)}" for k, v in given_values.items())).name
    defaults = parse_task("windy_gridworld").context
    for feature, value in given_values.items():
        assert (f"{feature}=" in name) == (value != defaults[feature])


@settings(deadline=None)
@given(demand_means)
def test_a_supply_chain_is_found_again_by_its_name_to_the_last_bit(mean: float) -> None:
    task = parse_task(f"supply_chain:demand_mean={mean!r}")
    assert task.context == {"demand_mean": mean}
    assert parse_task(task.name).name == task.name
    assert parse_task(task.name).context == task.context


@pytest.mark.parametrize(
    ("text", "name"),
    [
        ("supply_chain:demand_mean=2x", "supply_chain:demand_mean=5"),
        ("supply_chain:demand_mean=1x", "supply_chain"),
        ("supply_chain:demand_mean=.8x", "supply_chain:demand_mean=2"),
        ("supply_chain:demand_mean=2.50", "supply_chain"),
        ("supply_chain:demand_mean=1e1", "supply_chain:demand_mean=10"),
        (" supply_chain: demand_mean = 5 ", "supply_chain:demand_mean=5"),
        ("windy_gridworld:", "windy_gridworld"),
        ("windy_gridworld:wind=source", "windy_gridworld"),
        ("windy_gridworld:goal=[17,14],wind=small", "windy_gridworld:wind=small"),
        ("windy_gridworld:goal=[1,2],wind=small", "windy_gridworld:wind=small,goal=[1,2]"),
        ("windy_gridworld:wind=[0,0,-1,1,1,1,2,2,1,0,0,0,0,1,1,1,2,2,1,0]", "windy_gridworld:wind=small"),
    ],
)
def test_every_spelling_of_a_task_has_one_canonical_name(text: str, name: str) -> None:
    assert parse_task(text).name == name


@pytest.mark.parametrize(
    ("text", "parts"),
    [
        ("windy_grid", ["unknown task 'windy_grid'", "did you mean 'windy_gridworld'?", "supply_chain"]),
        ("chess", ["unknown task 'chess'", "there is windy_gridworld, supply_chain"]),
        ("", ["unknown task ''", "there is windy_gridworld"]),
        ("supply_chain:demnd_mean=5", ["'demnd_mean'", "did you mean 'demand_mean'?", "supply_chain"]),
        ("windy_gridworld:gravity=5x", ["'gravity'", "windy_gridworld", "wind, start, goal"]),
        ("windy_gridworld:wind", ["windy_gridworld:wind", "write wind=VALUE"]),
        ("windy_gridworld:wind=", ["write wind=VALUE", "got 'wind='"]),
        ("windy_gridworld:wind=small,wind=reversed", ["wind is given twice"]),
        ("windy_gridworld:wind=revers", ["wind must be", "reversed", "got 'revers'"]),
        ("windy_gridworld:wind=[1,2,3]", ["wind must be 20 whole numbers", "got '[1,2,3]'"]),
        ("windy_gridworld:start=[20,0]", ["start must be", "between 0 and 19", "got '[20,0]'"]),
        ("windy_gridworld:start=[1.5,0]", ["start must be 2 whole numbers", "got '[1.5,0]'"]),
        ("windy_gridworld:start=[17,14]", ["start and goal must differ", "[17, 14]"]),
        ("supply_chain:demand_mean=0", ["demand_mean must be a number between 1e-06 and 50", "got '0'"]),
        ("supply_chain:demand_mean=-1", ["demand_mean must be", "got '-1'"]),
        ("supply_chain:demand_mean=nan", ["demand_mean must be", "got 'nan'"]),
        ("supply_chain:demand_mean=inf", ["demand_mean must be", "got 'inf'"]),
        ("supply_chain:demand_mean=five", ["demand_mean must be", "got 'five'"]),
        ("supply_chain:demand_mean=1e-x", ["demand_mean must be a number, or a multiple such as 2x", "1e-x"]),
        ("supply_chain:demand_mean=100x", ["demand_mean must be", "between 1e-06 and 50", "got '100x'"]),
    ],
)
def test_a_wrong_name_is_refused_with_one_sentence_that_names_what_is_wrong(text: str, parts: list[str]) -> None:
    with pytest.raises(InputError) as caught:
        parse_task(text)
    message = str(caught.value)
    assert "\n" not in message
    assert [part for part in parts if part not in message] == []


def test_every_target_of_the_paper_has_a_name_that_is_found_again() -> None:
    for family in families().values():
        tasks = [parse_task(target) for target in family.targets]
        assert len({task.name for task in tasks}) == len(tasks) > 0
        assert [parse_task(task.name).context for task in tasks] == [task.context for task in tasks]


def test_every_tabular_target_of_the_paper_is_spelled_canonically_and_can_be_built() -> None:
    tabular = [target for family in families().values() if family.model for target in family.targets]
    assert len(tabular) == 6
    for target in tabular:
        assert parse_task(target).name == target
        assert make_env(parse_task(target)).reset(seed=0)
