"""Arms: every source of a target, and every pick of a source, has its own baseline, and keys that tell them apart."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from typing import Any

import pytest

from orchestrator.planning.arms import Arm, Key, Label, configuration_id, distinct, labels_of
from orchestrator.planning.params import check_params, keys
from orchestrator.planning.plan import source_arms, transfer_arms
from orchestrator.planning.source_choice import Choices, SourceChoice, SourceRun, settle, untrained
from search_spaces.loading import parse
from search_spaces.search_space import SearchSpace
from trainables.errors import InputError

ORIGIN, SMALL, REVERSED = "windy_gridworld", "windy_gridworld:wind=small", "windy_gridworld:wind=reversed"
AGENTS: dict[str, Any] = {"q_learning": {}, "delta_gate": {}}


def scenario(task: str, *, kinds: tuple[str, ...] = ("learned",), **source: Any) -> dict[str, Any]:
    rates = {"learning_rate": [0.5, 0.1]}
    return {
        "source": {"task": task, "kinds": list(kinds), "hyperparameters": rates, **source},
        "targets": [REVERSED],
    }


def space(*scenarios: dict[str, Any], agents: Mapping[str, Any] = AGENTS) -> SearchSpace:
    data = {"schema": 1, "name": "arms", "seeds": 2, "scenarios": list(scenarios), "agents": dict(agents)}
    return parse("arms", data | {"hyperparameters": {"episodes": 10}})


def chosen(arm: Arm, rate: float) -> SourceChoice:
    """Stage 1's outcome with this learning rate; the later seed is the better one."""
    cells = arm.cells({"learning_rate": rate, "episodes": 10})
    return SourceChoice({"learning_rate": rate}, {c.seed: SourceRun(c, float(c.seed), float(c.seed), 9) for c in cells})


def transfers(asked: SearchSpace, rates: Mapping[str, float]) -> list[Arm]:
    """The arms of stage 2, where stage 1 has settled these learning rates."""
    choices = settle(source_arms(asked, {}), {}, lambda arm: chosen(arm, rates[arm.task]))
    return transfer_arms(asked, choices, {})


def test_two_sources_with_other_learning_rates_have_a_baseline_each() -> None:
    arms = transfers(space(scenario(ORIGIN), scenario(SMALL)), {ORIGIN: 0.5, SMALL: 0.1})
    assert {arm.key: arm.grid[0]["learning_rate"] for arm in arms} == {
        Key(REVERSED, "q_learning", ORIGIN): 0.5,
        Key(REVERSED, "delta_gate", ORIGIN, "learned", "own_seed"): 0.5,
        Key(REVERSED, "q_learning", SMALL): 0.1,
        Key(REVERSED, "delta_gate", SMALL, "learned", "own_seed"): 0.1,
    }


def test_two_sources_with_one_learning_rate_share_their_baseline() -> None:
    arms = transfers(space(scenario(ORIGIN), scenario(SMALL)), {ORIGIN: 0.5, SMALL: 0.5})
    assert [arm.key for arm in arms if not arm.sources] == [Key(REVERSED, "q_learning")]


def test_one_source_with_two_picks_is_two_arms() -> None:
    asked = space(scenario(ORIGIN, kinds=("learned", "exact")), scenario(ORIGIN, pick="best_evaluated"))
    arms = [arm for arm in transfers(asked, {ORIGIN: 0.5}) if arm.sources]
    assert [(arm.key.kind, arm.pick) for arm in arms] == [
        ("learned", "own_seed"),
        ("exact", ""),
        ("learned", "best_evaluated"),
    ]
    own, best = arms[0], arms[2]
    assert best.sources[0][0][0].cell_id == best.sources[1][0][0].cell_id == own.sources[1][0][0].cell_id
    # seed 1 gets its own seed's knowledge either way: its cell is of both arms
    (shared,) = {cell.id for cell in own.all_cells()} & {cell.id for cell in best.all_cells()}
    labels = labels_of(arms, [cell for arm in arms for cell in arm.all_cells()])
    assert labels[shared] == [Label("own_seed"), Label("best_evaluated")]
    cells = {cell.id: cell for cell in own.all_cells()}
    ids = [configuration_id(cells[shared], label) for label in labels[shared]]
    assert ids[0] == cells[shared].group
    assert ids[1] != ids[0]


def test_the_same_scenario_twice_is_planned_once() -> None:
    assert len(transfers(space(scenario(ORIGIN), scenario(ORIGIN)), {ORIGIN: 0.5})) == 2


def test_of_two_arms_that_train_the_same_the_one_that_can_run_stays() -> None:
    sound = Arm("q_learning", REVERSED, (0, 1), baseline_for=ORIGIN)
    lost = dataclasses.replace(sound, baseline_for=SMALL, lost="its source has failed")
    assert [arm.lost for arm in distinct([lost, sound])] == [arm.lost for arm in distinct([sound, lost])] == [""]


def test_a_source_that_is_lost_loses_its_own_transfers_only() -> None:
    asked = space(
        scenario(ORIGIN, library=[SMALL]), scenario(SMALL), agents=AGENTS | {"delta_select": {}, "policy_reuse": {}}
    )

    def outcome(arm: Arm) -> SourceChoice:
        return untrained(arm, lost="no seed of it is done") if arm.task == SMALL else chosen(arm, 0.1)

    choices: list[Choices] = settle(source_arms(asked, {}), {}, outcome)
    arms = transfer_arms(asked, choices, {})
    lost = {(arm.agent, arm.key.source_task) for arm in arms if arm.lost}
    assert lost == {
        ("delta_select", ORIGIN),  # its library needs SMALL
        ("q_learning", SMALL),
        ("delta_gate", SMALL),
        ("policy_reuse", SMALL),
        ("delta_select", SMALL),
    }
    assert {arm.lost for arm in arms if arm.lost} == {"no seed of it is done"}
    assert all(arm.all_cells() for arm in arms)


def test_an_entry_without_a_source_task_or_a_pick_is_for_all_of_them() -> None:
    asked = space(scenario(ORIGIN), scenario(SMALL), scenario(SMALL, pick="best_evaluated"))
    old = {Key(REVERSED, "delta_gate", kind="learned"): {"threshold": 1.0, "episodes": 10}}
    new = {Key(REVERSED, "delta_gate", SMALL, "learned", "best_evaluated"): {"threshold": 2.0, "episodes": 10}}
    task = {Key(REVERSED, "delta_gate", SMALL, "learned"): {"threshold": 3.0, "episodes": 10}}
    choices = settle(source_arms(asked, {}), {}, untrained)

    def thresholds(params: dict[Key, dict[str, Any]]) -> list[float | None]:
        arms = [arm for arm in transfer_arms(asked, choices, params) if arm.sources]
        return [arm.grid[0].get("threshold") for arm in arms]

    assert thresholds(old) == [1.0, 1.0, 1.0]
    assert thresholds(old | task) == [1.0, 3.0, 3.0]
    assert thresholds(old | task | new) == [1.0, 3.0, 2.0]
    assert thresholds(new) == [None, None, 2.0]


def test_a_file_that_applies_to_nothing_is_refused_and_one_that_does_in_part_says_so() -> None:
    asked, values = space(scenario(ORIGIN)), {"episodes": 10}
    foreign = {Key("cartpole", "dqn"): values, Key("cartpole:gravity=5x", "es", "cartpole", "learned"): values}
    with pytest.raises(InputError) as error:
        check_params("best.yaml", foreign, asked)
    assert str(error.value) == (
        "best.yaml: 0 of 2 entries apply: it has dqn on cartpole, es on cartpole:gravity=5x (learned); arms needs "
        f"q_learning on windy_gridworld, q_learning on {REVERSED}, delta_gate on {REVERSED} (learned)"
    )
    fitting = {Key(REVERSED, "q_learning"): values}
    assert check_params("best.yaml", fitting, asked) == ""
    assert check_params("best.yaml", {}, asked) == ""
    assert check_params("best.yaml", fitting | foreign, asked) == (
        "best.yaml: 1 of 3 entries apply; not dqn on cartpole, es on cartpole:gravity=5x (learned)"
    )


def test_the_tasks_of_a_library_are_trained_where_something_is_learned() -> None:
    agents = {"q_learning": {}, "delta_select": {}}
    learned, exact = (
        source_arms(space(scenario(ORIGIN, library=[SMALL], kinds=(kind,)), agents=agents), {})
        for kind in ("learned", "exact")
    )
    assert [list(arms) for arms in learned] == [[ORIGIN, SMALL]]
    assert [list(arms) for arms in exact] == [[ORIGIN]]


def test_each_crosses_every_source_network_with_every_seed() -> None:
    asked = space(scenario(ORIGIN, pick="each", seeds=3), agents=AGENTS | {"policy_reuse": {}})
    base, gate, _ = arms = transfers(asked, {ORIGIN: 0.5})
    assert gate.key == Key(REVERSED, "delta_gate", ORIGIN, "learned", "each")
    cells = gate.all_cells()
    assert [cell.seed for cell in cells] == [0, 0, 0, 1, 1, 1]
    networks = [cell.sources[0].cell_id for cell in cells]
    assert networks[:3] == networks[3:]
    assert len(set(networks)) == 3
    assert gate.width == len(cells) == len({cell.id for cell in cells})
    assert all(gate.owns(cell) for cell in cells)
    assert base.width == 2
    sources = source_arms(asked, {})[0][ORIGIN]
    assert sources.seeds == (0, 1, 2)
    labels = labels_of(arms, cells)
    assert set(map(tuple, labels.values())) == {(Label("each"),)}
    assert len({configuration_id(cell, Label("each")) for cell in cells}) == 1
    assert gate.key in set(keys(asked))


def test_each_of_a_library_takes_a_source_seed_of_every_task_together() -> None:
    asked = space(scenario(ORIGIN, pick="each", library=[SMALL]), agents={"delta_select": {}})
    (arm,) = transfers(asked, {ORIGIN: 0.5, SMALL: 0.5})
    assert arm.width == 4
    tasks = [[source.task for source in cell.sources] for cell in arm.all_cells()]
    assert tasks == [[ORIGIN, SMALL]] * 4


def test_a_pretrained_source_that_serves_every_seed_is_one_network() -> None:
    asked = space(scenario(ORIGIN, pick="each"))
    arms = source_arms(asked, {})
    one = chosen(arms[0][ORIGIN], 0.5).runs[0]
    choices = settle(arms, {ORIGIN: {0: one, 1: one}}, lambda arm: chosen(arm, 0.5))
    assert [arm.width for arm in transfer_arms(asked, choices, {})] == [2, 2]


@pytest.mark.parametrize(
    ("source", "message"),
    [
        ({"pick": 7}, r"source\.pick must be one of the seeds \(got 7\)"),
        ({"seeds": [0], "pick": 1}, r"source\.pick must be one of the seeds \(got 1\)"),
        ({"seeds": [0, 5]}, r"source\.seeds lacks 1"),
        ({"seeds": [0, 0], "pick": "each"}, r"source\.seeds: 0 is given twice"),
        ({"pick": "every"}, r"source\.pick must be 'own_seed', 'best_evaluated', 'ranked' or 'each' \(got 'every'\)"),
    ],
)
def test_source_seeds_that_a_target_seed_cannot_get_are_refused(source: dict[str, Any], message: str) -> None:
    with pytest.raises(InputError, match=message):
        space(scenario(ORIGIN, **source))


def test_other_source_seeds_serve_all_targets_with_the_best_of_them() -> None:
    asked = space(scenario(ORIGIN, pick="best_evaluated", seeds=[5, 9]))
    gate = next(arm for arm in transfers(asked, {ORIGIN: 0.5}) if arm.sources)
    assert gate.seeds == (0, 1)
    assert len({cell.sources for cell in gate.all_cells()}) == 1
