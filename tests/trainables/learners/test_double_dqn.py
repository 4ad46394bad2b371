"""Double DQN as an option of every deep agent: its targets are those of van Hasselt, Guez and Silver (2016)."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import torch

from trainables.agents.registry import AGENTS
from trainables.cell import Cell, Source
from trainables.knowledge import Knowledge
from trainables.learners.dqn import DeepLearner
from trainables.learners.targets import double_targets
from trainables.training.train import train

SMALL: dict[str, Any] = {
    "episodes": 4,
    "evaluate_every": 2,
    "evaluation_episodes": 1,
    "hidden_size": 16,
    "batch_size": 16,
    "replay_capacity": 150,
    "target_update": 40,
    "learning_rate": 1e-2,
    "epsilon_start": 0.3,
}
TARGET = "cartpole:gravity=5x,limit=40"
DEEP = [name for name, agent in AGENTS.items() if agent.kind == "deep"]


@pytest.fixture(scope="module")
def source() -> Knowledge:
    learner = DeepLearner(Cell.create("dqn", "cartpole", 0, SMALL), None)
    learner.run(20)
    return learner.knowledge()


def cell(agent: str, **given: Any) -> Cell:
    named = Source(task="cartpole", kind="learned", cell_id="0" * 16, steps=200)
    few = {"relative_es": {"floor_updates": 20}, "replay_seed": {"source_transitions": 50}}.get(agent, {})
    return Cell.create(agent, TARGET, 0, SMALL | few | given, None if agent == "dqn" else named)


@pytest.mark.parametrize("truncation", ["bootstrap", "terminal"])
def test_targets_are_those_of_the_paper_computed_by_torch(truncation: str) -> None:
    learner = DeepLearner(cell("dqn", double=True, truncation=truncation), None)
    learner.run(30)
    batch = learner._replay.sample(learner._targets)
    double_targets(learner._replay, batch, learner._q, learner._target, learner._advice)
    memory, at = learner._replay.memory, batch.indices
    online, target = (network.as_module() for network in (learner._q, learner._target))  # type: ignore[attr-defined]
    after = torch.from_numpy(memory.next_observations[at])
    with torch.no_grad():
        chosen = online(after).argmax(dim=1, keepdim=True)
        values = target(after).gather(1, chosen)[:, 0]
        plain = target(after).max(dim=1).values
    goes_on = torch.from_numpy(~memory.cut[at])
    expected = torch.from_numpy(memory.rewards[at]) + 0.99 * goes_on * values
    np.testing.assert_allclose(batch.td_targets, expected.numpy(), atol=1e-5)
    assert not torch.allclose(goes_on * values, goes_on * plain), "the two networks choose differently somewhere"


def test_torchs_network_learns_the_same_targets() -> None:
    ours = DeepLearner(cell("dqn", double=True), None)
    module = "tests.trainables.learners.test_double_dqn:perceptron"
    theirs = DeepLearner(cell("dqn", double=True, module=module), None)
    ours.run(20)
    theirs.run(1)
    theirs._replay.restore(ours._replay.state())
    theirs._q.load_vector(ours._q.vector())
    theirs._target.load_vector(ours._target.vector())
    found = []
    for learner in (ours, theirs):
        batch = learner._replay.sample(learner._targets)
        double_targets(learner._replay, batch, learner._q, learner._target, learner._advice)
        found.append(batch.td_targets.copy())
    np.testing.assert_allclose(*found, atol=1e-5)


def perceptron(inputs: int, actions: int) -> torch.nn.Module:
    """The built-in perceptron as somebody's own module."""
    layers = torch.nn.Linear(inputs, 16), torch.nn.ReLU(), torch.nn.Linear(16, 16), torch.nn.ReLU()
    return torch.nn.Sequential(*layers, torch.nn.Linear(16, actions))


@pytest.mark.parametrize("agent", DEEP)
def test_every_deep_agent_has_the_option_and_keeps_its_ids_without_it(agent: str, source: Knowledge) -> None:
    plain, double = cell(agent), cell(agent, double=True)
    assert "double" not in plain.to_json()["hyperparameters"]
    assert Cell.from_json(plain.to_json()) == plain
    assert double.id != plain.id
    curves = [
        [point.training_return for point in train(each, source if each.sources else None)] for each in (plain, double)
    ]
    assert len(curves[0]) == len(curves[1]) == 3
