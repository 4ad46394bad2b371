"""The JSON Schema that editors read: published as it is made, and of one mind with what is accepted and refused."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import jsonschema
import pytest

from search_spaces.json_schema import json_schema
from search_spaces.loading import built_in, parse
from search_spaces.safe_yaml import read_yaml
from trainables.errors import InputError

PUBLISHED = Path(__file__).parents[2] / "docs" / "search-space.schema.json"
VALIDATOR = jsonschema.Draft202012Validator(json_schema())
SPACE: dict[str, Any] = {
    "schema": 1,
    "name": "mine",
    "seeds": [0, 2],
    "scenarios": [{"source": {"task": "cartpole", "agent": "dqn", "pick": 0}, "targets": ["cartpole:gravity=5x"]}],
    "hyperparameters": {"episodes": 5, "learning_rate": [0.1, 0.2], "hidden_size": {"values": [4, 8], "paper": "none"}},
    "agents": {"dqn": {}, "es": {"advice_fraction": {"low": 0.1, "high": 1, "log": True}}},
    "search": {"method": "random", "budget": 3},
}


def test_the_published_schema_is_up_to_date() -> None:
    """If not: deltatune spaces --schema > docs/search-space.schema.json."""
    assert json.loads(PUBLISHED.read_text()) == json_schema()


def test_it_is_a_schema_and_explains_itself() -> None:
    jsonschema.Draft202012Validator.check_schema(json_schema())
    assert "Stage 2 uses the best values" in json.dumps(json_schema())


@pytest.mark.parametrize("name", sorted(built_in()))
def test_every_built_in_space_agrees_with_it(name: str) -> None:
    VALIDATOR.validate(read_yaml(built_in()[name]))


def test_every_way_of_writing_a_hyperparameter_agrees_with_it() -> None:
    VALIDATOR.validate(SPACE)
    assert parse("mine", SPACE).seeds == (0, 2)


@pytest.mark.parametrize(
    "change",
    [
        {"seed": 5},
        {"seeds": 0},
        {"seeds": []},
        {"seeds": "five"},
        {"schema": 2},
        {"name": "a b"},
        {"agents": ["dqn"]},
        {"agents": {}},
        {"scenarios": []},
        {"scenarios": [{"source": {"task": "cartpole"}, "targets": []}]},
        {"scenarios": [{"targets": ["cartpole"]}]},
        {"hyperparameters": {"episodes": []}},
        {"hyperparameters": {"episodes": {"low": 1}}},
        {"search": {"method": "guess"}},
    ],
)
def test_what_it_refuses_is_refused_by_the_program_too(change: dict[str, Any]) -> None:
    assert not VALIDATOR.is_valid(SPACE | change)
    with pytest.raises(InputError):
        parse("mine", SPACE | change)
