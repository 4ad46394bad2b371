"""What is registered of an agent, and what it costs to look at it."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from trainables.agents.registry import AGENTS
from trainables.cell import Cell, Source
from trainables.tasks.registry import parse_task

HEAVY = ("numba", "torch", "scipy", "gymnasium", "pandas", "ray", "mlflow", "matplotlib")
GRID, CART = "windy_gridworld", "cartpole"


def test_the_registry_loads_nothing_heavy() -> None:
    code = f"import sys, trainables.agents.registry as r; print([m for m in {HEAVY!r} if m in sys.modules])"
    root = Path(__file__).parents[3]
    done = subprocess.run([sys.executable, "-c", code], cwd=root, capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"


@pytest.mark.parametrize("agent", AGENTS.values(), ids=list(AGENTS))
def test_what_an_entry_names_is_there(agent) -> None:
    fields = agent.hyperparameters.model_fields
    assert set(agent.shown) <= set(fields)
    assert set(agent.hyperparameters.unwritten) <= set(fields)
    assert agent.base is None or AGENTS[agent.base].kind == agent.kind
    assert all(plot.level in ("", "threshold") for plot in agent.plots)


@pytest.mark.parametrize(
    "agent", [agent for agent in AGENTS.values() if agent.hyperparameters.unwritten], ids=lambda agent: agent.name
)
def test_a_hyperparameter_younger_than_recorded_cells_has_in_them_the_value_that_they_had(agent) -> None:
    source = Source(task=CART, kind="learned", cell_id="0" * 16) if agent.needs_source else None
    old = {**agent.hyperparameters.unwritten}
    now, then = Cell.create(agent.name, CART, 0, None, source), Cell.create(agent.name, CART, 0, old, source)
    assert not set(old) & set(then.to_json()["hyperparameters"])
    assert Cell.from_json(then.to_json()).hyperparameters == then.hyperparameters
    changed = {name for name, value in old.items() if now.hyperparameters[name] != value}
    assert {name for name in old if name in now.to_json()["hyperparameters"]} == changed
    assert len({now.id, then.id}) == len({now.group, then.group}) == (2 if changed else 1)


def test_the_papers_threshold_for_a_task_is_that_of_algorithm_1() -> None:
    chain = parse_task("supply_chain")
    thresholds = [
        AGENTS[name].resolve(chain, {}).model_dump()["threshold"] for name in ("delta_gate", "confidence_gate")
    ]
    assert thresholds == [chain.family.defaults["threshold"], 1.0]
