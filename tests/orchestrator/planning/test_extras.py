"""A sweep whose task or agent lacks its library says which extra brings it, and nothing has been written by then."""

from __future__ import annotations

import tomllib
from pathlib import Path

import pytest

from orchestrator.execution.forecast import forecast
from orchestrator.execution.session import SweepSession
from orchestrator.execution.settings import Settings
from orchestrator.planning.extras import require_runnable
from orchestrator.results.sweep_folder import Results
from search_spaces.loading import load, parse
from search_spaces.narrow import narrow
from trainables import extras
from trainables.agents.registry import agents
from trainables.cell import Cell
from trainables.errors import InputError
from trainables.tasks.make import make_env
from trainables.tasks.registry import families, parse_task
from trainables.training.train import train

ROOT = Path(__file__).parents[3]


@pytest.fixture
def bare(monkeypatch: pytest.MonkeyPatch) -> None:
    """An installation without any extra."""
    monkeypatch.setattr(extras, "_there", lambda extra: False)


def test_a_tabular_space_needs_no_extra(bare: None) -> None:
    for name in ("demo", "paper-gridworld", "paper-supply-chain", "choose-source", "metric-validity"):
        require_runnable(load(name))


@pytest.mark.parametrize(
    ("task", "names"),
    [("cartpole", "deltatune[deep]"), ("reacher", "deltatune[deep,mujoco]"), ("lunar_lander", "deltatune[box2d,deep]")],
)
def test_a_space_says_every_extra_that_it_lacks(bare: None, task: str, names: str, tmp_path: Path) -> None:
    space = narrow(load("small-table1"), tasks=[task])
    with pytest.raises(InputError) as error, SweepSession.open(tmp_path, "it", space):
        pass
    assert f"pip install '{names}'" in str(error.value)
    assert "\n" not in str(error.value)
    assert not list(tmp_path.iterdir())
    with pytest.raises(InputError, match="not installed"):
        forecast(space, Settings(), Results.prepare(tmp_path, "it"), 1)


@pytest.mark.parametrize("name", ["agent", "task"])
def test_a_recorded_space_names_the_file_of_custom_code_that_it_lacks(name: str, tmp_path: Path) -> None:
    lost = {"agent": "gone.py@01234567:Agent", "task": "gone.py@01234567:Task"}[name]
    data = load("demo").to_json()
    scenario = {"source": {"task": lost}, "targets": [lost]}
    space = parse("recorded", data | ({"agents": {lost: {}}} if name == "agent" else {"scenarios": [scenario]}))
    with pytest.raises(InputError) as error, SweepSession.open(tmp_path, "it", space):
        pass
    assert f"the {name} {lost} needs gone.py as it was then (@01234567)" in str(error.value)
    assert "--file gone.py" in str(error.value)
    assert not list(tmp_path.iterdir())
    with pytest.raises(InputError, match=r"--file gone\.py"):
        forecast(space, Settings(), Results.prepare(tmp_path, "it"), 1)


def test_a_cell_and_an_environment_say_the_same(bare: None) -> None:
    with pytest.raises(InputError, match=r"dqn needs PyTorch, which is not .*deltatune\[deep\]"):
        train(Cell.create("dqn", "cartpole", 0))
    with pytest.raises(InputError, match=r"reacher needs MuJoCo, which is not .*deltatune\[mujoco\]"):
        make_env(parse_task("reacher"))


def test_every_extra_that_is_named_is_one_of_the_package() -> None:
    named = {family.extra for family in families().values()} | {agent.extra for agent in agents().values()}
    known = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["optional-dependencies"]
    assert named - {""} <= extras.EXTRAS.keys() <= known.keys()
    assert all(extras._there(extra) for extra in extras.EXTRAS)
