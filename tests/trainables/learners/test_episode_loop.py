"""The compiled episodes equal the plain step loop bit for bit, and stand aside where they cannot."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from trainables.cell import Cell, Source
from trainables.errors import TrainingError
from trainables.knowledge import Knowledge, joined
from trainables.learners.advice import ExplicitShaping
from trainables.learners.delta_select_es import DeepSelectLearner
from trainables.learners.dqn import DeepLearner

SMALL: dict[str, Any] = {
    "episodes": 40,
    "evaluation_episodes": 3,
    "hidden_size": 16,
    "batch_size": 16,
    "replay_capacity": 120,
    "target_update": 37,
    "learning_rate": 1e-3,
    "epsilon_start": 0.4,
}
AGENTS = ["dqn", "es", "delta_es", "dpba", "delta_dpba", "delta_select_es", "warm_start", "constant_es"]
OPTIONS: list[tuple[str, dict[str, Any]]] = [
    ("dqn", {"loss": "huber"}),
    ("dqn", {"epsilon_unit": "steps", "epsilon_decay": 60.0, "truncation": "terminal"}),
    ("dqn", {"max_gradient_norm": 0.05, "gamma": 0.5, "hidden_layers": 1}),
    ("dqn", {"batch_size": 200, "replay_capacity": 200}),
    ("dqn", {"double": True, "truncation": "terminal"}),
    ("delta_es", {"double": True}),
    ("delta_select_es", {"double": True}),
    ("es", {"evaluation_policy": "shaped", "advice_fraction": 0.5}),
    ("delta_es", {"delta_after_advice": "train"}),
    ("delta_es", {"loss": "huber", "evaluation_policy": "shaped", "delta_learning_rate": 1e-2}),
    ("delta_select_es", {"threshold": 0.001}),
]
TASKS = {"cartpole": "cartpole:gravity=5x,limit=40", "acrobot": "acrobot:link_mass=1.5,limit=60"}


@pytest.fixture(scope="module")
def sources() -> dict[str, Knowledge]:
    """What a dqn agent has learned on each source task."""
    learners = {name: DeepLearner(Cell.create("dqn", f"{name}:limit=50", 0, SMALL), None) for name in TASKS}
    for learner in learners.values():
        learner.run(8)
    return {name: learner.knowledge() for name, learner in learners.items()}


def pair(agent: str, name: str, sources: dict[str, Knowledge], **given: Any) -> tuple[DeepLearner, DeepLearner]:
    """Two learners of the same cell, the second in plain Python."""
    count = {"dqn": 0, "delta_select_es": 2}.get(agent, 1)
    named = tuple(Source(task=name, kind="learned", cell_id=f"{k:016x}", steps=500) for k in range(count))
    cell = Cell.create(agent, TASKS[name], 3, SMALL | given, named if count > 1 else (named or (None,))[0])
    knowledge = joined([sources[name]] * count) if count else None
    made = DeepSelectLearner if agent == "delta_select_es" else DeepLearner
    compiled, plain = made(cell, knowledge), made(cell, knowledge)
    plain._loop = plain._late_loop = None  # type: ignore[misc]
    return compiled, plain


def same(ours: Any, theirs: Any) -> bool:
    """Whether two states are equal bit for bit."""
    if isinstance(ours, dict):
        return ours.keys() == theirs.keys() and all(same(ours[key], theirs[key]) for key in ours)
    if isinstance(ours, np.ndarray):
        return ours.dtype == theirs.dtype and ours.tobytes() == theirs.tobytes()
    return bool(ours == theirs)


def train_both(compiled: DeepLearner, plain: DeepLearner, blocks: int = 3) -> None:
    assert compiled._loop is not None
    for _ in range(blocks):
        for learner in (compiled, plain):
            learner.run(6)
        assert same(compiled.state(), plain.state())
        assert compiled.evaluate() == plain.evaluate()
    assert same(compiled.knowledge().arrays, plain.knowledge().arrays)


@pytest.mark.parametrize("name", TASKS)
@pytest.mark.parametrize("agent", AGENTS)
def test_every_deep_agent_learns_the_same_bits(agent: str, name: str, sources: dict[str, Knowledge]) -> None:
    compiled, plain = pair(agent, name, sources)
    train_both(compiled, plain)
    assert compiled.steps > SMALL["replay_capacity"], "the buffer is overwritten"
    assert compiled._advice.kappa == (1.0 if "dpba" in agent else 0.0), "the advice has ended where it ends"


@pytest.mark.parametrize(("agent", "given"), OPTIONS)
def test_every_option_learns_the_same_bits(agent: str, given: dict[str, Any], sources: dict[str, Knowledge]) -> None:
    train_both(*pair(agent, "cartpole", sources, **given))


LATE: dict[str, dict[str, Any]] = {
    "corrected_es": {},
    "relative_es": {"floor_updates": 20},
    "jsrl": {},
    "ppr_dqn": {"nu": 0.1},
    "kickstart": {},
    "replay_seed": {"source_transitions": 60},
    "shuffled_es": {},
}


@pytest.mark.parametrize("agent", LATE)
def test_a_source_used_in_another_way_is_left_to_the_plain_loop_until_its_use_has_ended(
    agent: str, sources: dict[str, Knowledge]
) -> None:
    found, plain = pair(agent, "cartpole", sources, **LATE[agent])
    assert found._loop is None
    assert found._advice.kappa == 1.0
    for _ in range(3):
        for learner in (found, plain):
            learner.run(8)
        assert same(found.state(), plain.state())
    assert found._advice.kappa == 0.0
    assert "_late_loop" in vars(found)
    assert found._late_loop is not None


def test_minibatches_beyond_the_first_block_are_drawn_alike(sources: dict[str, Knowledge]) -> None:
    compiled, plain = pair("dqn", "acrobot", sources)
    train_both(compiled, plain, blocks=4)
    assert compiled._updates == plain._updates
    assert compiled.steps > 1024 + SMALL["batch_size"]


def test_a_state_moves_between_the_two(sources: dict[str, Knowledge]) -> None:
    compiled, plain = pair("delta_es", "cartpole", sources)
    compiled.run(5)
    plain.restore(compiled.state())
    train_both(compiled, plain)


def test_a_loss_that_is_not_finite_is_told_alike(sources: dict[str, Knowledge]) -> None:
    told = []
    for learner in pair("dqn", "cartpole", sources, learning_rate=1.0, hidden_layers=4, max_gradient_norm=1e30):
        learner._q.load_vector(np.full_like(learner._q.vector(), 1e20))
        with pytest.raises(TrainingError) as caught:
            learner.run(20)
        told.append((str(caught.value), learner._steps, learner._updates))
    assert told[0] == told[1]


class Cautious(DeepLearner):
    """An agent with a choice of its own."""

    def _action(self, observation: Any) -> int:
        return 0


class Doubled(ExplicitShaping):
    """Advice with a choice of its own."""

    def best(self, q: Any, observation: Any) -> int:
        return 1


def test_what_is_not_known_is_left_to_the_plain_loop(sources: dict[str, Knowledge]) -> None:
    cell = Cell.create("dqn", TASKS["cartpole"], 0, SMALL)
    assert Cautious(cell, None)._loop is None
    assert DeepLearner(Cell.create("dqn", "lunar_lander", 0, SMALL), None)._loop is None
    module = {"module": "tests.trainables.learners.test_dqn:tiny_module"}
    assert DeepLearner(Cell.create("dqn", TASKS["cartpole"], 0, SMALL | module), None)._loop is None
    learner, _ = pair("es", "cartpole", sources)
    learner._advice = Doubled(learner._settings, learner._advice.source, None, 500)
    assert learner._loop is None
