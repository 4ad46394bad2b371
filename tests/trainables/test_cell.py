"""A cell: its content id, its JSON, and what it refuses."""

from __future__ import annotations

import json
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from trainables.cell import Cell, Source
from trainables.errors import InputError

SMALL = "windy_gridworld:wind=small"
LEARNED = Source(task="windy_gridworld", kind="learned", cell_id="0123456789abcdef")
EXACT = Source(task="windy_gridworld", kind="exact")


def _gate(**changes: Any) -> Cell:
    arguments: dict[str, Any] = {"agent": "delta_gate", "task": SMALL, "seed": 0, "source": LEARNED}
    return Cell.create(**arguments | changes)


# --- the id ----------------------------------------------------------------------------------------------------


def test_the_id_of_a_cell_is_what_it_was_when_the_first_results_were_written() -> None:
    # A changed id orphans every result on disk. If one of these must change, raise cell.SCHEMA and say so.
    assert Cell.create("q_learning", "windy_gridworld", 0).id == "6b4198bf52c96051"
    assert _gate().id == "4297719492dbda7b"
    assert Cell.create("ppr", "supply_chain:demand_mean=5", 4, {"nu": 0.9}, LEARNED).id == "14729b095a4f3189"


def test_every_field_takes_part_in_the_id() -> None:
    variants = [
        _gate(),
        _gate(agent="confidence_gate"),
        _gate(agent="q_warm_start"),
        _gate(task="windy_gridworld:wind=reversed"),
        _gate(seed=1),
        _gate(source=EXACT),
        _gate(source=LEARNED.model_copy(update={"cell_id": "fedcba9876543210"})),
        _gate(source=LEARNED.model_copy(update={"task": SMALL})),
        _gate(source=LEARNED.model_copy(update={"checkpoint": "best"})),
        _gate(source=LEARNED.model_copy(update={"steps": 1000})),
        *[_gate(hyperparameters={key: value}) for key, value in OTHER_VALUES.items()],
    ]
    assert set(OTHER_VALUES) == set(_gate().hyperparameters)
    assert len({cell.id for cell in variants}) == len(variants)


OTHER_VALUES = {
    "episodes": 4999,
    "evaluate_every": 20,
    "gamma": 0.98,
    "learning_rate": 0.1,
    "epsilon_start": 0.2,
    "epsilon_decay": 1e-3,
    "truncation": "terminal",
    "delta_learning_rate": 0.1,
    "threshold": 3.0,
}


def test_equal_cells_have_equal_ids_however_they_were_written() -> None:
    plain = _gate()
    assert _gate(task="windy_gridworld: wind = small, start=[3,0]").id == plain.id
    assert _gate(hyperparameters={"learning_rate": 0.5, "threshold": 10}).id == plain.id
    assert _gate(source=LEARNED.model_copy(update={"task": "windy_gridworld:wind=source"})).id == plain.id


def test_cells_of_one_group_differ_in_their_seed_alone() -> None:
    other_source = LEARNED.model_copy(update={"cell_id": "fedcba9876543210"})
    group = _gate().group
    assert _gate(seed=7, source=other_source).group == group  # each seed has a source of its own
    for change in ({"agent": "q_warm_start"}, {"task": "windy_gridworld"}, {"source": EXACT}):
        assert _gate(**change).group != group
    assert _gate(hyperparameters={"threshold": 3.0}).group != group


# --- JSON ------------------------------------------------------------------------------------------------------

rates = st.floats(0, 1, exclude_min=True)
hyperparameters = st.fixed_dictionaries(
    {},
    optional={
        "episodes": st.integers(1, 10**9),
        "gamma": st.floats(0, 1, exclude_max=True),
        "learning_rate": rates,
        "epsilon_decay": st.floats(0, 1e300),
        "delta_learning_rate": rates,
        "threshold": st.one_of(st.floats(0, 1e300), st.integers(0, 100)),
        "truncation": st.sampled_from(["terminal", "bootstrap"]),
    },
)


@settings(deadline=None)
@given(hyperparameters, st.integers(0, 2**40), st.sampled_from([LEARNED, EXACT]))
def test_a_cell_comes_back_from_json_as_it_was(values, seed, source) -> None:
    cell = _gate(seed=seed, hyperparameters=values, source=source)
    again = Cell.from_json(json.loads(json.dumps(cell.to_json(), allow_nan=False)))
    assert again == cell
    assert again.id == cell.id
    assert again.settings == cell.settings


@pytest.mark.parametrize(
    ("change", "parts"),
    [
        ({"schema": 2}, ["schema must be 1", "got 2"]),
        ({"schema": None}, ["schema must be 1", "got None"]),
        ({"learning_rate": 0.5}, ["learning_rate is not a known key"]),
        ({"seed": "0"}, ["seed", "got '0'"]),
        ({"seed": True}, ["seed", "got True"]),
        ({"seed": -1}, ["seed", "got -1"]),
        ({"seed": 1.0}, ["seed", "got 1.0"]),
        ({"agent": "sarsa"}, ["unknown agent 'sarsa'"]),
        ({"agent": 3}, ["agent", "got 3"]),
        ({"task": "chess"}, ["unknown task 'chess'"]),
        ({"hyperparameters": {"learning_rate": "0.5"}}, ["learning_rate", "got '0.5'"]),
        ({"hyperparameters": {"lr": 0.5}}, ["unknown hyperparameter of delta_gate 'lr'"]),
        ({"hyperparameters": [1]}, ["hyperparameters must be a mapping", "got [1]"]),
        ({"source": None}, ["delta_gate needs a source task"]),
        ({"source": {"task": "windy_gridworld", "kind": "guessed"}}, ["source.kind", "got 'guessed'"]),
        ({"source": {"task": "windy_gridworld", "kind": "exact", "x": 1}}, ["source.x is not a known key"]),
    ],
)
def test_json_that_is_no_cell_is_refused(change: dict[str, Any], parts: list[str]) -> None:
    with pytest.raises(InputError) as caught:
        Cell.from_json(_gate().to_json() | change)
    assert "\n" not in str(caught.value)
    assert [part for part in parts if part not in str(caught.value)] == []


@pytest.mark.parametrize("data", [None, [], "cell", 5])
def test_json_that_is_no_object_is_refused(data: object) -> None:
    with pytest.raises(InputError, match="a cell must be an object"):
        Cell.from_json(data)


@pytest.mark.parametrize("key", ["schema", "agent", "task", "seed", "hyperparameters"])
def test_json_without_one_of_its_keys_is_refused(key: str) -> None:
    data = _gate().to_json()
    del data[key]
    with pytest.raises(InputError, match=key):
        Cell.from_json(data)


# --- hyperparameters -------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("key", "value", "shown"),
    [
        ("learning_rate", float("nan"), "nan"),
        ("learning_rate", -0.1, "-0.1"),
        ("learning_rate", 0.0, "0.0"),
        ("learning_rate", 1.5, "1.5"),
        ("learning_rate", float("inf"), "inf"),
        ("learning_rate", "fast", "'fast'"),
        ("learning_rate", "0.5", "'0.5'"),
        ("learning_rate", None, "None"),
        ("learning_rate", True, "True"),
        ("learning_rate", [0.5], "[0.5]"),
        ("episodes", 0, "0"),
        ("episodes", 2.5, "2.5"),
        ("evaluate_every", 0, "0"),
        ("gamma", 1.0, "1.0"),
        ("epsilon_start", 1.1, "1.1"),
        ("epsilon_decay", -1e-9, "-1e-09"),
        ("truncation", "never", "'never'"),
        ("threshold", float("nan"), "nan"),
        ("threshold", -1.0, "-1.0"),
        ("delta_learning_rate", 0.0, "0.0"),
    ],
)
def test_a_hyperparameter_out_of_its_range_is_refused_with_its_name_and_value(key, value, shown) -> None:
    with pytest.raises(InputError) as caught:
        _gate(hyperparameters={key: value})
    message = str(caught.value)
    assert message.startswith(f"delta_gate: {key} must")
    assert message.endswith(f"(got {shown})")
    assert "\n" not in message


def test_an_unknown_hyperparameter_is_refused_with_the_nearest_and_the_list() -> None:
    with pytest.raises(InputError, match=r"'learning_rte': did you mean 'learning_rate'\?.*threshold"):
        _gate(hyperparameters={"learning_rte": 0.1})


@pytest.mark.parametrize(
    ("agent", "task", "expected"),
    [
        ("delta_gate", SMALL, {"episodes": 5000, "threshold": 10.0, "delta_learning_rate": 0.05}),
        ("delta_gate", "supply_chain", {"episodes": 1000, "threshold": 5.0, "delta_learning_rate": 0.1}),
        ("confidence_gate", SMALL, {"episodes": 5000, "threshold": 1.0, "z": 3.0, "min_visits": 5, "sd_floor": 0.3}),
        ("confidence_gate", "supply_chain", {"episodes": 1000, "threshold": 1.0}),
        ("ppr", SMALL, {"psi_start": 1.0, "nu": 0.99}),
        ("ppr", SMALL, {"learning_rate": 0.5, "epsilon_start": 0.1, "epsilon_decay": 5e-4, "gamma": 0.99}),
    ],
)
def test_the_papers_values_are_the_defaults(agent: str, task: str, expected: dict[str, Any]) -> None:
    source = EXACT.model_copy(update={"task": task.partition(":")[0]})
    assert expected.items() <= Cell.create(agent, task, 0, None, source).hyperparameters.items()


# --- sources ---------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("agent", ["policy_reuse", "ppr", "delta_gate", "confidence_gate", "q_warm_start"])
def test_an_agent_with_transfer_needs_a_source(agent: str) -> None:
    with pytest.raises(InputError, match=f"{agent} needs a source task"):
        Cell.create(agent, SMALL, 0)


@pytest.mark.parametrize("source", [LEARNED, EXACT])
def test_q_learning_takes_no_source(source: Source) -> None:
    with pytest.raises(InputError, match=r"q_learning takes no source \(got windy_gridworld\)"):
        Cell.create("q_learning", SMALL, 0, None, source)


def test_a_learned_source_names_its_cell_and_an_exact_one_does_not() -> None:
    with pytest.raises(InputError, match="the learned source needs a cell id"):
        _gate(source=Source(task="windy_gridworld", kind="learned"))
    with pytest.raises(InputError, match="the exact source has no cell id"):
        _gate(source=Source(task="windy_gridworld", kind="exact", cell_id="0123456789abcdef"))
    with pytest.raises(InputError, match="unknown task 'windy'"):
        _gate(source=Source(task="windy", kind="exact"))


def test_the_id_and_the_group_are_hashed_once(monkeypatch: pytest.MonkeyPatch) -> None:
    cell = _gate()
    before = cell.id, cell.group
    monkeypatch.setattr("trainables.cell.content_id", lambda data: pytest.fail("hashed again"))
    assert (cell.id, cell.group) == before


def test_a_library_without_a_source_beside_it_is_refused() -> None:
    data = _gate().to_json() | {"agent": "delta_select", "hyperparameters": {}, "source": None}
    with pytest.raises(InputError, match="a cell with a library needs a source"):
        Cell.from_json(data | {"library": [EXACT.model_dump()]})


def test_exact_sources_are_told_apart_by_task_and_gamma_and_learned_ones_by_their_cell() -> None:
    keys = {
        _gate(source=EXACT).source_key,
        _gate(source=EXACT, hyperparameters={"gamma": 0.9}).source_key,
        _gate(source=EXACT.model_copy(update={"task": SMALL})).source_key,
        _gate(source=LEARNED).source_key,
    }
    assert len(keys) == 4
    assert Cell.create("q_learning", SMALL, 0).source_key == ""


def test_a_cell_cannot_be_changed() -> None:
    with pytest.raises(ValueError, match="frozen"):
        _gate().seed = 1  # type: ignore[misc]
