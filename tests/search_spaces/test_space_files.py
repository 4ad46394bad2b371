"""Search spaces in YAML files: what is read, and what is refused."""

from __future__ import annotations

import math
from pathlib import Path

import pytest
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st
from small_space import SMALL, changed

from search_spaces.domains import Grid, Range
from search_spaces.loading import load, parse
from search_spaces.safe_yaml import read_yaml, scalar
from trainables.errors import InputError


def _file(folder: Path, text: str) -> Path:
    path = folder / "space.yaml"
    path.write_text(text, encoding="utf-8")
    return path


def test_a_users_file_is_read_like_a_built_in_one(tmp_path: Path) -> None:
    path = _file(tmp_path, yaml.safe_dump(SMALL))
    assert load(str(path)) == parse("small", SMALL)


@pytest.mark.parametrize(
    ("text", "value"),
    [("1e-4", 1e-4), ("5E3", 5e3), ("-1e+2", -100.0), (".5e1", 5.0), ("1.5e-3", 1.5e-3), ("5", 5), ("0.1", 0.1)],
)
def test_numbers_are_read_as_numbers_with_or_without_a_point(tmp_path: Path, text: str, value: float) -> None:
    read = read_yaml(_file(tmp_path, f"learning_rate: {text}"))["learning_rate"]
    assert (type(read), read) == (type(value), value)
    assert scalar(text) == value


@settings(deadline=None)
@given(st.floats(allow_nan=False, allow_infinity=False))
def test_any_float_as_python_writes_it_is_that_float(value: float) -> None:
    read = scalar(repr(value))
    assert isinstance(read, float)
    assert read == value


@pytest.mark.parametrize("text", ["terminal", "e5", "1e", "1e-", "1.2.3", "small"])
def test_text_stays_text(text: str) -> None:
    assert scalar(text) == text


@pytest.mark.parametrize("text", ["", "[1", "[1]", "{a: 1}", "null", "2024-01-01", "2024-13-45", "a: b: c"])
def test_what_is_no_value_is_refused(text: str) -> None:
    with pytest.raises(InputError, match="is not a value"):
        scalar(text)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("seeds: 5\nname: a\nseeds: 6\n", "line 1: key 'seeds' is given twice"),
        ("agents:\n  ppr: {nu: 1, nu: 2}\n", "line 2: key 'nu' is given twice"),
        ("agents: [1\nname: x", "line 2: "),
        ("a: 'unfinished", "line 1: found unexpected end of stream"),
        ("? [1, 2]\n: 3", "unhashable key"),
        ("a: !!python/object/apply:os.system ['true']", "could not determine a constructor"),
        ("a: 2024-13-45", "month must be in 1..12"),
        ("a: \x07", "not YAML"),
    ],
)
def test_yaml_that_cannot_be_read_is_refused_with_the_file_and_the_reason(tmp_path, text: str, message: str) -> None:
    path = _file(tmp_path, text)
    with pytest.raises(InputError) as caught:
        load(str(path))
    assert str(caught.value).startswith(str(path))
    assert message in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_file_that_cannot_be_opened_is_refused_with_the_reason(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"cannot read .*none.yaml: No such file"):
        load(str(tmp_path / "none.yaml"))
    (tmp_path / "folder.yaml").mkdir()
    with pytest.raises(InputError, match=r"cannot read .*folder.yaml: Is a directory"):
        load(str(tmp_path / "folder.yaml"))
    (tmp_path / "latin.yaml").write_bytes(b"name: \xe9")
    with pytest.raises(InputError, match=r"cannot read .*latin.yaml"):
        load(str(tmp_path / "latin.yaml"))


def test_an_unknown_name_is_answered_with_the_nearest_and_the_list() -> None:
    with pytest.raises(InputError, match=r"'paper-gridwrld': did you mean 'paper-gridworld'\?.*demo"):
        load("paper-gridwrld")


def test_a_value_a_list_and_a_mapping_say_the_same() -> None:
    spellings = (0.1, [0.1], {"values": [0.1]})
    spaces = [parse("x", changed("hyperparameters.learning_rate", spelling)) for spelling in spellings]
    assert spaces[0] == spaces[1] == spaces[2]
    assert spaces[0].hyperparameters["learning_rate"] == Grid(values=(0.1,))


def test_seeds_are_a_number_or_a_list() -> None:
    assert parse("x", changed("seeds", 3)).seeds == (0, 1, 2)
    assert parse("x", changed("seeds", [7, 0])).seeds == (7, 0)


def test_ranges_are_read_and_keep_their_ends() -> None:
    data = changed("search", {"method": "optuna", "budget": 7})
    data["agents"]["delta_gate"] = {"threshold": {"low": 0.5, "high": 10, "log": True}}
    space = parse("x", data)
    assert space.agents["delta_gate"]["threshold"] == Range(low=0.5, high=10.0, log=True)
    assert parse("x", space.to_json()) == space


# --- every bad input is one sentence that names the value ------------------------------------------------------

NAN, RANGE = math.nan, {"low": 0.1, "high": 0.5}
BAD = {
    "an unknown key": ("budget", 5, ["budget is not a known key"]),
    "an unknown nested key": ("scenarios.0.source.tasks", "x", ["tasks is not a known key"]),
    "another schema": ("schema", 2, ["schema", "got 2"]),
    "a name that is no name": ("name", "a/b", ["name", "got 'a/b'"]),
    "a name of the wrong type": ("name", 5, ["name", "got 5"]),
    "zero seeds": ("seeds", 0, ["seeds must be at least 1", "got 0"]),
    "negative seeds": ("seeds", -3, ["seeds must be at least 1", "got -3"]),
    "no seeds": ("seeds", [], ["seeds must not be empty"]),
    "a negative seed": ("seeds", [0, -1], ["seeds", "got -1"]),
    "seeds in words": ("seeds", "five", ["seeds", "got 'five'"]),
    "auto with a typo": ("seeds", {"auto": {"grup": 4}}, ["seeds: auto.grup is not a known key"]),
    "auto with a strange key": ("seeds", {"automatic": {}}, ["seeds: auto is missing"]),
    "groups of one": ("seeds", {"auto": {"group": 1}}, ["seeds: auto.group must", "got 1"]),
    "an error of one": ("seeds", {"auto": {"alpha": 1}}, ["seeds: auto.alpha must", "got 1"]),
    "half a group": ("seeds", {"auto": {"group": 4}}, ["max must be a multiple of group (got 30 and 4)"]),
    "half a seed": ("seeds", 1.5, ["seeds", "got 1.5"]),
    "true seeds": ("seeds", True, ["seeds", "got True"]),
    "a seed twice": ("seeds", [0, 1, 0], ["seeds: 0 is given twice"]),
    "no scenarios": ("scenarios", [], ["scenarios must not be empty"]),
    "no targets": ("scenarios.0.targets", [], ["targets must not be empty"]),
    "a target that is no list": ("scenarios.0.targets", "windy_gridworld", ["targets must be a list"]),
    "an unknown source": ("scenarios.0.source.task", "windy", ["unknown task 'windy'"]),
    "an unknown target": ("scenarios.0.targets.0", "windy_gridwrld", ["'windy_gridwrld'", "did you mean"]),
    "an unknown feature": ("scenarios.0.targets.0", "windy_gridworld:winds=small", ["'winds'", "did you mean 'wind'"]),
    "a feature out of range": ("scenarios.0.targets.0", "windy_gridworld:goal=[99,0]", ["goal", "got '[99,0]'"]),
    "a target twice": (
        "scenarios.0.targets",
        ["windy_gridworld:wind=small", "windy_gridworld:start=[3,0],wind=small"],
        ["windy_gridworld:wind=small is given twice"],
    ),
    "a target of another shape": (
        "scenarios.0.targets.0",
        "supply_chain",
        ["supply_chain has 2601 states and 100 actions", "400 states and 4"],
    ),
    "an unknown kind of source": ("scenarios.0.source.kinds", ["guessed"], ["kinds", "got 'guessed'"]),
    "a source that needs one itself": ("scenarios.0.source.agent", "ppr", ["source.agent", "got ppr"]),
    "an unknown source agent": ("scenarios.0.source.agent", "sarsa", ["unknown agent 'sarsa'"]),
    "no agents": ("agents", {}, ["agents must not be empty"]),
    "agents as a list": ("agents", ["ppr"], ["agents must be a mapping", "got ['ppr']"]),
    "an unknown agent": ("agents.q_lerning", {}, ["unknown agent 'q_lerning'", "did you mean 'q_learning'"]),
    "an unknown hyperparameter": ("agents.ppr.nuu", 1, ["unknown hyperparameter of ppr 'nuu'", "mean 'nu'?"]),
    "a negative learning rate": ("agents.ppr.learning_rate", -0.1, ["learning_rate must", "got -0.1"]),
    "a learning rate of nan": ("agents.ppr.learning_rate", NAN, ["learning_rate", "got nan"]),
    "a learning rate in words": ("agents.ppr.learning_rate", "fast", ["learning_rate must", "got 'fast'"]),
    "a learning rate in quotes": ("agents.ppr.learning_rate", "0.5", ["learning_rate must", "got '0.5'"]),
    "a learning rate of yes": ("agents.ppr.learning_rate", True, ["learning_rate must", "got True"]),
    "a bad value among good ones": ("agents.ppr.learning_rate", [0.5, 2.0], ["learning_rate must", "got 2.0"]),
    "no values": ("agents.ppr.learning_rate", [], ["learning_rate", "must not be empty"]),
    "null": ("agents.ppr.learning_rate", None, ["learning_rate", "got None"]),
    "a bad shared value": ("hyperparameters.gamma", 1.0, ["gamma must", "got 1.0"]),
    "a shared key of no agent": ("hyperparameters.psi", 1.0, ["hyperparameters.psi", "none of the agents"]),
    "a bad source value": ("scenarios.0.source.hyperparameters.learning_rate", 0, ["learning_rate must", "got 0"]),
    "a range without a search": ("agents.ppr.nu", RANGE, ["ppr.nu is a range", "search"]),
    "a range the wrong way": ("agents.ppr.nu", {"low": 2, "high": 1}, ["low must be less than high", "2 and 1"]),
    "a range with one end": ("agents.ppr.nu", {"low": 2}, ["high is missing"]),
    "a range on a log scale from 0": ("agents.ppr.nu", {"low": 0, "high": 1, "log": True}, ["greater than 0"]),
    "a range with a typo": ("agents.ppr.nu", {"low": 0, "hihg": 1}, ["ppr.nu"]),
    "a range to infinity": ("agents.ppr.nu", {"low": 0, "high": math.inf}, ["high must", "got inf"]),
    "an unknown method": ("search.method", "gird", ["search.method", "got 'gird'"]),
    "an empty budget": ("search.budget", 0, ["search.budget", "got 0"]),
}


@pytest.mark.parametrize(("path", "value", "parts"), BAD.values(), ids=BAD)
def test_bad_input_is_refused_with_one_sentence_that_names_the_value(path: str, value: object, parts) -> None:
    with pytest.raises(InputError) as caught:
        parse("my.yaml", changed(path, value))
    message = str(caught.value)
    assert message.startswith("my.yaml: ")
    assert "\n" not in message
    assert "Value error" not in message
    assert [part for part in parts if part not in message] == []


@pytest.mark.parametrize("key", ["schema", "name", "seeds", "scenarios", "agents"])
def test_a_missing_key_is_named(key: str) -> None:
    with pytest.raises(InputError, match=f"my.yaml: {key} is missing"):
        parse("my.yaml", {name: value for name, value in SMALL.items() if name != key})


@pytest.mark.parametrize("data", [None, [], "demo", 5])
def test_data_that_is_no_mapping_is_refused(data: object) -> None:
    with pytest.raises(InputError, match=r"my\.yaml: a search space must be a mapping"):
        parse("my.yaml", data)


def test_a_range_is_checked_at_both_ends_like_a_value() -> None:
    data = changed("agents.ppr.nu", {"low": 0.5, "high": 1.5})
    data["search"] = {"method": "random"}
    with pytest.raises(InputError, match=r"nu must be less than or equal to 1 \(got 1.5\)"):
        parse("my.yaml", data)
