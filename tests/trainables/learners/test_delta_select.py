"""delta_select and delta_select_es: which source they follow, and when none."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from trainables import curve
from trainables.agents.builtin.delta_select_es import DeltaSelectShaping
from trainables.cell import Cell, Source
from trainables.delta.exact import exact_q
from trainables.errors import InputError
from trainables.evaluation import expected_return
from trainables.knowledge import Knowledge, joined, parts
from trainables.learners import delta_select
from trainables.learners.delta_select import NONE, PathDelta, choose
from trainables.learners.delta_select_es import Selection
from trainables.networks.network import new_network
from trainables.storage.checkpoint import load, save
from trainables.tasks.rollout import Transitions
from trainables.training.source_knowledge import source_knowledge
from trainables.training.train import Training, train

WINDS = [f"windy_gridworld:wind={name}" for name in ("source", "small", "additional_1", "additional_2", "reversed")]
SHORT = {"episodes": 60, "evaluate_every": 20}


def _exact(task: str) -> Source:
    return Source(task=task, kind="exact")


def _cell(target: str, sources: list[str], seed: int = 0, **values: object) -> Cell:
    return Cell.create("delta_select", target, seed, SHORT | values, map(_exact, sources))


# --- cells with a library ----------------------------------------------------------------------------------------


def test_a_library_is_part_of_the_cell_and_its_json_and_without_one_nothing_changes() -> None:
    plain, more = _cell(WINDS[4], WINDS[:1]), _cell(WINDS[4], WINDS[:3])
    assert "library" not in plain.to_json()
    assert len({plain.id, more.id, _cell(WINDS[4], [WINDS[0], WINDS[2], WINDS[1]]).id}) == 3
    assert Cell.from_json(more.to_json()) == more
    assert len({plain.group, more.group}) == 2
    assert more.group == _cell(WINDS[4], WINDS[:3], seed=1).group
    assert len({plain.source_key, more.source_key}) == 2


def test_the_ids_of_cells_without_a_library_are_what_they_were() -> None:
    assert Cell.create("q_learning", "windy_gridworld", 0).id == _KNOWN["q_learning"]
    gate = Cell.create("delta_gate", "windy_gridworld:wind=small", 0, None, _exact("windy_gridworld"))
    assert gate.id == _KNOWN["delta_gate"]


_KNOWN = {"q_learning": "6b4198bf52c96051", "delta_gate": "1f9213a6cfc7adfc"}
"""Ids before cells knew of libraries."""


def test_only_an_agent_that_chooses_takes_a_library_and_each_source_once() -> None:
    with pytest.raises(
        InputError, match=r"delta_gate takes one source \(got windy_gridworld, windy_gridworld:wind=small\)"
    ):
        Cell.create("delta_gate", WINDS[4], 0, None, [_exact(WINDS[0]), _exact(WINDS[1])])
    with pytest.raises(InputError, match="has a source twice"):
        _cell(WINDS[4], [WINDS[0], WINDS[1], "windy_gridworld"])


@settings(deadline=None)
@given(st.integers(1, 12))
def test_knowledge_of_several_sources_comes_apart_as_it_was_joined(count: int) -> None:
    each = [Knowledge({"q": np.full((2, 2), float(i)), "steps": np.array(i)}) for i in range(count)]
    assert [part.digest for part in parts(joined(each), count)] == [part.digest for part in each]


def test_a_learned_source_of_the_library_is_asked_for_by_its_cell() -> None:
    learned = Source(task=WINDS[1], kind="learned", cell_id="0" * 16)
    cell = Cell.create("delta_select", WINDS[4], 0, SHORT, [_exact(WINDS[0]), learned])
    asked: list[str] = []
    given = source_knowledge(cell, lambda name: (asked.append(name), Knowledge({"q": exact_q(WINDS[1], 0.99)}))[1])
    assert asked == ["0" * 16]
    assert len(list(train(cell, given))) == 4
    with pytest.raises(InputError, match="needs the knowledge of its source cell 0000000000000000"):
        train(cell)


# --- the choice --------------------------------------------------------------------------------------------------


def _paths(followed: list[int], mean: list[float], own: float, first: float = -np.inf) -> PathDelta:
    return PathDelta(np.array(followed), np.array(mean), np.zeros(1), np.array([own, first]), np.zeros(2, np.int64))


def test_every_source_is_followed_once_then_the_best_and_none_where_q_trg_does_better() -> None:
    promises = np.array([-30.0, -40.0])
    assert choose(promises, _paths([1, 0], [0.0, 0.0], 0.0), 3.0, 0.3, 0.5) == 1
    assert choose(promises, _paths([9, 9], [-50.0, -5.0], -60.0), 3.0, 0.3, 0.5) == 1
    assert choose(promises, _paths([9, 9], [-50.0, -5.0], -40.0), 3.0, 0.3, 0.5) == NONE
    assert choose(promises, _paths([9, 1], [-16.0, -6.5], -60.0), 3.0, 0.3, 0.5) == 1  # -45.7 to -45.6
    assert choose(promises, _paths([9, 1], [-16.0, -6.5], -60.0), 0.0, 0.3, 0.5) == 0


def test_a_source_that_does_not_keep_its_promise_over_an_untrained_agent_is_not_followed() -> None:
    promises = np.array([-40.0])  # 60 over -100
    assert choose(promises, _paths([9], [-35.0], -90.0, -100.0), 0.0, 0.3, 0.5) == NONE  # 25 of them
    assert choose(promises, _paths([9], [-35.0], -90.0, -100.0), 0.0, 0.3, 0.4) == 0
    assert choose(promises, _paths([9], [-25.0], -90.0, -100.0), 0.0, 0.3, 0.5) == 0  # 35 of them


@pytest.mark.parametrize("target", WINDS)
def test_a_source_equal_to_the_target_is_found_in_the_library(target: str) -> None:
    others = [task for task in WINDS if task != target and task not in WINDS[:2]]
    training = train(_cell(target, [*others, target]))
    last = list(training)[-1]
    assert last.statistics["source"] == float(len(others))
    best = exact_q(target, 0.99).argmax(axis=1)
    assert last.greedy_return == expected_return(delta_select.model_of(target), best, 0.99)[0]
    assert abs(last.statistics["path_delta"]) < 5


def test_where_every_source_fails_it_is_q_learning_in_the_end() -> None:
    points = list(train(_cell(WINDS[4], WINDS[:2], episodes=800, evaluate_every=100)))
    assert points[0].statistics["source"] != NONE
    assert points[-1].statistics["source"] == NONE
    assert points[-1].greedy_return > -100
    assert points[-1].statistics["source_action_share"] == 0.0


def test_the_same_cell_gives_the_same_bits_and_how_often_one_evaluates_changes_nothing() -> None:
    training = [train(_cell(WINDS[2], WINDS[:2], evaluate_every=every)) for every in (20, 20, 7)]
    digests = [curve.digest(curve.columns(each)) for each in training]
    assert digests[0] == digests[1] != digests[2]
    assert len({each.knowledge().digest for each in training}) == 1


@pytest.mark.skipif(not hasattr(delta_select.run_episodes, "py_func"), reason="nothing is compiled")
def test_the_compiled_loop_and_the_choice_are_the_plain_ones(monkeypatch) -> None:
    cell = _cell(WINDS[2], WINDS[:2], episodes=8, evaluate_every=4)
    fast = train(cell)
    compiled = curve.digest(curve.columns(fast))
    for name in ("choose", "record_episode", "worth_following"):
        monkeypatch.setattr(delta_select, name, getattr(delta_select, name).py_func)
    monkeypatch.setattr(delta_select, "run_episodes", delta_select.run_episodes.py_func)
    slow = train(cell)
    assert curve.digest(curve.columns(slow)) == compiled
    assert slow.knowledge().digest == fast.knowledge().digest


# --- deep --------------------------------------------------------------------------------------------------------

TINY = {
    "episodes": 12,
    "evaluate_every": 4,
    "evaluation_episodes": 3,
    "batch_size": 8,
    "hidden_size": 8,
    "target_update": 20,
}


@pytest.fixture(scope="module")
def networks() -> list[Knowledge]:
    found = []
    for seed in range(2):
        training = train(Cell.create("dqn", "cartpole", seed, TINY))
        list(training)
        found.append(training.knowledge())
    return found


def _deep_cell(count: int = 2, **values: object) -> Cell:
    sources = [
        Source(task="cartpole", kind="learned", cell_id=f"{i}" * 16, checkpoint="best", steps=400) for i in range(count)
    ]
    return Cell.create("delta_select_es", "cartpole:gravity=5x", 0, TINY | values, sources)


def test_a_deep_cell_resumes_bit_for_bit_with_its_choice(networks, tmp_path) -> None:
    cell, given = _deep_cell(), joined(networks)
    whole = list(train(cell, given))
    first = train(cell, given)
    half = [next(first), next(first)]
    save(tmp_path / "state", first.state())
    second: Training = train(cell, given)
    second.restore(load(tmp_path / "state"))
    assert curve.digest(curve.columns([*half, *second])) == curve.digest(curve.columns(whole))


def test_sources_whose_delta_exceeds_what_it_is_at_home_give_no_advice(networks) -> None:
    # On a target where nothing is as at home, with no excess allowed and none given to chance.
    points = list(train(_deep_cell(threshold=0.0, z=0.0, floor="greedy"), joined(networks)))
    advised = [point for point in points[2:] if point.statistics["source"] != -1.0]
    assert all(point.statistics["delta_excess"] <= 0.0 for point in advised)
    others = [point for point in points[2:] if point.statistics["source"] == -1.0]
    assert all(point.statistics["advice_factor"] == 0.0 for point in others)
    assert others


def test_the_source_with_the_smaller_delta_gives_the_advice(networks) -> None:
    wrong = Knowledge({**networks[0].arrays, "best": networks[0].arrays["best"] * np.float32(50)})
    for order in ([wrong, networks[1]], [networks[1], wrong]):
        last = list(train(_deep_cell(threshold=1e9), joined(order)))[-1]
        assert last.statistics["source"] == (1.0 if order[0] is wrong else 0.0)


def test_delta_is_held_against_what_it_is_at_home_with_as_much_exploration(networks) -> None:
    """A network errs where its own policy does not go: with epsilon 1 a delta of 4 is as at home, with .1 it is not."""
    settings = _deep_cell(1, z=0.0, threshold=1.0).settings
    assert isinstance(settings, DeltaSelectShaping)
    network = new_network(settings, 4, 2, 1.0)  # Q_src is 0, so that delta is the reward
    states = np.zeros((50, 4), np.float32)
    seen = Transitions(states, np.zeros(50, np.int64), np.full(50, 4, np.float32), states, np.zeros(50, np.bool_))
    exploring = np.array([[0.1, 0.2, 0.4, 4.0]])
    excess = []
    for floors, epsilon in ((exploring, 1.0), (exploring, 0.1), (exploring[:, :1], 1.0)):
        selection = Selection(settings, [network], floors, 100)
        selection.observe(seen, 5, epsilon)
        excess.append(selection.excess)
        assert (selection.chosen == NONE) == (selection.excess > 1.0)
    assert excess == pytest.approx([0.0, 3.8, 3.9], abs=1e-6)
