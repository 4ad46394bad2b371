"""What a field means is read from its source, when it is shown."""

from __future__ import annotations

from pathlib import Path

from pydantic import Field

from search_spaces.field_docs import field_docs
from trainables.agents.base import Count, Hyperparameters, Rate
from trainables.agents.registry import AGENTS, agent_named
from trainables.custom import load


class Based(Hyperparameters):
    """A class with a text of its own, one that is inherited, one that is replaced and one that is given up."""

    gamma: Rate = 0.5
    """Another discount."""
    episodes: Count = 3
    unsaid: Count = Field(default=1, description="said elsewhere")
    steps: Count = 1
    """Steps,
    over two lines."""


def test_the_text_below_a_field_is_what_it_means() -> None:
    docs = field_docs(Based)
    assert docs["gamma"] == "Another discount."
    assert docs["steps"] == "Steps,\nover two lines."
    assert docs["evaluate_every"].startswith("Episodes between greedy evaluations.")
    assert not docs.keys() & {"episodes", "unsaid"}


def test_every_hyperparameter_of_every_agent_is_explained() -> None:
    for agent in AGENTS.values():
        assert field_docs(agent.hyperparameters).keys() == agent.hyperparameters.model_fields.keys(), agent.name


def test_those_of_a_custom_file_are_read_too(tmp_path: Path) -> None:
    (tmp_path / "docs_of_mine.py").write_text(
        "from deltatune import agent\n"
        "from trainables.agents.hyperparameters import Hyperparameters, Rate\n"
        "class Mine(Hyperparameters):\n"
        "    keenness: Rate = 0.5\n"
        '    """How keen it is."""\n'
        "class Learner:\n"
        "    run = evaluate = knowledge = lambda self: None\n"
        "Agent = agent(Learner, Mine)\n"
    )
    mine = agent_named(load(f"{tmp_path / 'docs_of_mine.py'}:Agent"))
    assert field_docs(mine.hyperparameters)["keenness"] == "How keen it is."
