"""safe_start: a warm start beside DQN, which leads where it is better and is given up where it is worse."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from trainables.cell import Cell, Source
from trainables.errors import InputError
from trainables.knowledge import Knowledge
from trainables.learners.baselines.safe_start import LEAST, SafeStart
from trainables.learners.dqn import DeepLearner

SMALL: dict[str, Any] = {
    "episodes": 200,
    "evaluation_episodes": 3,
    "hidden_size": 16,
    "batch_size": 16,
    "replay_capacity": 500,
    "target_update": 40,
    "learning_rate": 1e-3,
}


@pytest.fixture(scope="module")
def source() -> Knowledge:
    """A source that pushes the cart to where the pole falls, with weights set by hand."""
    first, second, last = np.zeros((16, 4)), np.zeros((16, 16)), np.zeros((2, 16))
    first[0], first[1] = (0, 0, 1, 1), (0, 0, -1, -1)
    second[0, 0] = second[1, 1] = last[1, 0] = last[0, 1] = 1.0
    layers = [(weight.ravel(), np.zeros(len(weight))) for weight in (first, second, last)]
    vector = np.concatenate([part for layer in layers for part in layer]).astype(np.float32)
    counts = {"best_return": np.array(200.0), "steps": np.array(1000)}
    return Knowledge({"sizes": np.array([4, 16, 16, 2]), "last": vector, "best": vector.copy(), **counts})


def learner(source: Knowledge, **given: Any) -> DeepLearner:
    named = Source(task="cartpole", kind="learned", cell_id="0" * 16, checkpoint="best")
    return DeepLearner(Cell.create("safe_start", "cartpole:gravity=12", 0, SMALL | given, named), source)


def advice(found: DeepLearner) -> SafeStart:
    assert isinstance(found._advice, SafeStart)
    return found._advice


def negated(source: Knowledge) -> Knowledge:
    """The source with its last layer negated: it prefers the worst action."""
    arrays = {name: array.copy() for name, array in source.arrays.items()}
    for name in ("last", "best"):
        arrays[name][-(16 + 1) * 2 :] *= -1
    return Knowledge(arrays)


def test_before_any_probe_it_is_evaluated_as_dqn(source: Knowledge) -> None:
    found = learner(source)
    plain = DeepLearner(Cell.create("dqn", "cartpole:gravity=12", 0, SMALL), None)
    assert found.evaluate().greedy_return == plain.evaluate().greedy_return


def test_a_source_that_helps_leads_and_is_what_is_evaluated_and_kept(source: Knowledge) -> None:
    found = learner(source, learning_rate=1e-5)
    found.run(40)
    strategy = advice(found)
    assert strategy.leads
    assert found.evaluate().statistics["transfer_leads"] == 1.0
    np.testing.assert_array_equal(found.knowledge().arrays["last"], strategy._network.vector())
    states = found._remembered_states()
    np.testing.assert_array_equal(found.preferences(states), strategy._network.rows(states))


def test_a_source_that_hurts_is_given_up_for_good_and_what_follows_is_dqn(source: Knowledge) -> None:
    found = learner(negated(source), learning_rate=1e-5)
    found.run(60)
    strategy = advice(found)
    assert strategy.kappa == 0.0
    assert not strategy.leads
    before = strategy._network.vector()
    found.run(10)
    np.testing.assert_array_equal(strategy._network.vector(), before)
    statistics = found.evaluate().statistics
    assert (statistics["given_up"], statistics["transfer_leads"]) == (1.0, 0.0)
    np.testing.assert_array_equal(found.knowledge().arrays["last"], found._q.vector())


def test_the_rule_is_an_interval_of_the_last_probes(source: Knowledge) -> None:
    strategy = advice(learner(source, recent=5, z=2.0))

    def play(ours: float, theirs: float) -> None:
        for episode, value in ((0, theirs), (1, 1e9), (2, ours), (3, -1e9)):
            strategy.episode(episode)
            strategy.ended(value)

    for _ in range(LEAST - 1):
        play(10.0, 20.0)
    assert not strategy.leads, "too few probes"
    play(10.0, 20.0)
    assert strategy.leads
    for value in (15.0, 16.0, 17.0, 18.0, 19.0):
        play(value, 35 - value)
    assert strategy.leads, "no difference that is clear changes nothing"
    assert strategy.kappa == 1.0
    for _ in range(5):
        play(30.0, 20.0)
    assert not strategy.leads
    assert strategy.kappa == 0.0


def test_the_probes_are_nearly_greedy_episodes_of_both_networks(source: Knowledge) -> None:
    strategy = advice(learner(source, epsilon_end=0.0))
    observation = np.array([0.01, 0.2, -0.02, 0.1], np.float32)
    strategy.episode(0)
    assert strategy.guided(observation) == int(strategy._network.row(observation).argmax())
    strategy.episode(2)
    assert strategy.guided(observation) == int(strategy._q.row(observation).argmax())
    strategy.episode(1)
    assert strategy.guided(observation) is None, "DQN acts as ever"


def test_the_ablation_begins_with_other_weights_than_the_sources_and_dqns(source: Knowledge) -> None:
    found = learner(source, begins="fresh")
    strategy = advice(found)
    vectors = [strategy._network.vector(), found._q.vector(), strategy.source.vector()]
    assert all(not np.array_equal(vectors[i], vectors[j]) for i, j in ((0, 1), (0, 2), (1, 2)))


def test_weights_that_do_not_fit_are_refused(source: Knowledge) -> None:
    with pytest.raises(InputError, match="safe_start begins with the source's weights, whose hidden layers have"):
        learner(source, hidden_size=8)
