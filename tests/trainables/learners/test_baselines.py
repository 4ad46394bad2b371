"""The deep baselines: each does with its source what it says, and all of them can be interrupted."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from trainables.cell import Cell, Source
from trainables.curve import EvalPoint
from trainables.errors import InputError
from trainables.knowledge import Knowledge
from trainables.learners.baselines.ablations import ConstantFactor, ShuffledFactor
from trainables.learners.baselines.corrected import CorrectedAdvice
from trainables.learners.baselines.gated_init import GatedInit
from trainables.learners.baselines.jump_start import JumpStart
from trainables.learners.baselines.relative import RelativeDelta
from trainables.learners.dqn import DeepLearner
from trainables.learners.greedy_evaluation import greedy_returns
from trainables.numerics.matmul import F32
from trainables.storage import checkpoint
from trainables.tasks.make import make_env
from trainables.tasks.registry import parse_task
from trainables.tasks.step_env import Environment
from trainables.training.train import Training, train

SMALL: dict[str, Any] = {
    "episodes": 12,
    "evaluate_every": 4,
    "evaluation_episodes": 3,
    "hidden_size": 16,
    "batch_size": 8,
    "replay_capacity": 150,
    "target_update": 40,
    "learning_rate": 1e-3,
    "epsilon_start": 0.3,
}
AGENTS: dict[str, dict[str, Any]] = {
    "warm_start": {},
    "safe_start": {},
    "corrected_es": {},
    "relative_es": {"floor_updates": 20},
    "jsrl": {},
    "ppr_dqn": {},
    "kickstart": {},
    "replay_seed": {"source_transitions": 50},
    "dqinit": {"known_after": 5},
    "constant_es": {},
    "shuffled_es": {},
}
TARGET = "cartpole:gravity=5x"


@pytest.fixture(scope="module")
def source() -> Knowledge:
    training = train(Cell.create("dqn", "cartpole", 0, SMALL | {"episodes": 20}))
    list(training)
    return training.knowledge()


def cell(agent: str, task: str = TARGET, steps: int = 10_000, **given: Any) -> Cell:
    named = Source(task="cartpole", kind="learned", cell_id="0" * 16, steps=steps)
    return Cell.create(agent, task, 0, SMALL | AGENTS.get(agent, {}) | given, None if agent == "dqn" else named)


def begin(agent: str, source: Knowledge, **given: Any) -> Training:
    return train(cell(agent, **given), None if agent == "dqn" else source)


def learner(agent: str, source: Knowledge, **given: Any) -> DeepLearner:
    return DeepLearner(cell(agent, **given), None if agent == "dqn" else source)


def curve(points: Iterator[EvalPoint]) -> list[dict[str, Any]]:
    return [{key: value for key, value in asdict(point).items() if key != "seconds"} for point in points]


def returns(training: Training) -> list[tuple[float, float | None]]:
    return [(point.greedy_return, point.training_return) for point in training]


def remembered(found: DeepLearner) -> F32:
    return found._replay.memory.observations[: found._replay.size]


@pytest.mark.parametrize("steps", [200, 10_000])
@pytest.mark.parametrize("agent", AGENTS)
def test_interrupted_and_resumed_is_bit_for_bit_uninterrupted(
    agent: str, steps: int, source: Knowledge, tmp_path: Path
) -> None:
    """Both where the use of the source ends within the run and where it does not."""
    whole = begin(agent, source, steps=steps)
    expected = curve(whole)
    halted, resumed = (begin(agent, source, steps=steps) for _ in range(2))
    points = curve(point for _, point in zip(range(2), halted, strict=False))
    checkpoint.save(tmp_path / "state", halted.state())
    resumed.restore(checkpoint.load(tmp_path / "state"))
    assert points + curve(resumed) == expected
    assert resumed.knowledge().digest == whole.knowledge().digest


def test_a_warm_starts_first_greedy_return_is_that_of_the_sources_policy(source: Knowledge) -> None:
    found = learner("warm_start", source, evaluation_episodes=5)
    rng = np.random.default_rng()
    rng.bit_generator.state = found.state()["rngs"]["evaluation_env"]
    seeds = [int(rng.integers(2**31)) for _ in range(5)]
    envs = [Environment(make_env(parse_task(TARGET))) for _ in seeds]
    network = learner("es", source)._advice.source
    assert network is not None
    theirs, _ = greedy_returns(envs, seeds, network.rows, 0.99)
    assert found.evaluate().greedy_return == theirs.mean()
    assert learner("dqn", source, evaluation_episodes=5).evaluate().greedy_return != theirs.mean()


def test_a_fresh_last_layer_is_all_that_is_not_the_sources(source: Knowledge) -> None:
    warm, fresh, plain = (
        learner(agent, source, **given)._q.vector()
        for agent, given in (("warm_start", {}), ("warm_start", {"last_layer": "fresh"}), ("dqn", {}))
    )
    last = 17 * 2
    np.testing.assert_array_equal(warm, source.arrays["last"])
    np.testing.assert_array_equal(fresh[:-last], source.arrays["last"][:-last])
    np.testing.assert_array_equal(fresh[-last:], plain[-last:])
    np.testing.assert_array_equal(learner("warm_start", source)._target.vector(), warm)


def test_a_warm_start_explores_by_its_own_schedule(source: Knowledge) -> None:
    points = list(begin("warm_start", source, warm_epsilon=0.2, warm_decay_share=0.01))
    assert points[0].statistics["epsilon"] == pytest.approx(0.2)
    assert points[-1].statistics["epsilon"] == pytest.approx(0.01 + 0.19 * np.exp(-12 / 5))


def test_a_warm_start_from_another_shape_is_refused(source: Knowledge) -> None:
    with pytest.raises(InputError, match=r"hidden layers have \[16, 16\] units, but .* ask for \[24, 24\]"):
        begin("warm_start", source, hidden_size=24)


def test_corrected_advice_follows_q_src_plus_delta(source: Knowledge) -> None:
    found = learner("corrected_es", source)
    found.run(4)
    advice = found._advice
    assert isinstance(advice, CorrectedAdvice)
    opposite = advice.source.vector()
    opposite[-17 * 2 :] *= -2  # Q_src + delta = -Q_src
    advice.delta.load_vector(opposite)
    changed = 0
    for state in remembered(found)[:30]:
        q, q_src, delta = (net.row(state).copy() for net in (found._q, advice.source, advice.delta))
        expected = int(np.argmax(q + advice.kappa * (q_src + delta)))
        assert advice.best(q, state) == expected
        changed += expected != np.argmax(q + advice.kappa * q_src)
    assert changed, "delta changes an action somewhere"


@pytest.mark.parametrize("floor", ["state", "quantile"])
def test_the_relative_factor_is_1_where_delta_is_the_sources_own_error(floor: str, source: Knowledge) -> None:
    found = learner("relative_es", source, floor=floor)
    found.run(4)
    advice, states = found._advice, remembered(found)
    assert isinstance(advice, RelativeDelta)
    before = advice.factor(states)
    advice.delta.load_vector(advice._floor.vector())
    ours = states if floor == "state" else states[np.abs(advice.delta.rows(states)).max(axis=1) <= advice._quantile]
    assert len(ours)
    np.testing.assert_array_equal(advice.factor(ours), 1)
    if floor == "state":
        assert before.max() < 1


def test_the_relative_factor_has_no_unit(source: Knowledge) -> None:
    """Rewards of ten times the size scale Q_src, both deltas and the range of A_src, and leave the factor."""
    found = learner("relative_es", source, floor="state")
    found.run(4)
    advice, states = found._advice, remembered(found)
    assert isinstance(advice, RelativeDelta)
    expected = advice.factor(states)
    last = 17 * 2
    for network in (advice.delta, advice._floor, advice.source):
        vector = network.vector()
        vector[-last:] *= 10
        network.load_vector(vector)
    advice._unit *= 10
    np.testing.assert_allclose(advice.factor(states), expected, rtol=1e-4)


def test_relative_shaping_acts_by_its_factor(source: Knowledge) -> None:
    found = learner("relative_es", source, floor="state")
    found.run(4)
    advice = found._advice
    assert isinstance(advice, RelativeDelta)
    for state in remembered(found)[:20]:
        q, q_src = found._q.row(state).copy(), advice.source.row(state).copy()
        factor = float(advice.factor(state[None])[0])
        assert 0 < factor < 1
        assert advice.best(q, state) == int(np.argmax(q + advice.kappa * factor * q_src))


def acted(found: DeepLearner, episodes: int) -> tuple[list[int], list[int]]:
    """The actions of so many episodes, and the source's in the same states, while the buffer is not full."""
    before = found._replay.size
    found.run(episodes)
    memory, after = found._replay.memory, found._replay.size
    assert after < found._replay.capacity
    assert found._advice.source is not None
    theirs = found._advice.source.rows(memory.observations[before:after]).argmax(axis=1)
    return memory.actions[before:after].tolist(), theirs.tolist()


def test_the_source_takes_the_first_steps_of_an_episode(source: Knowledge) -> None:
    found = learner("jsrl", source, epsilon_start=1.0, replay_capacity=1000, advice_fraction=1.0)
    advice = found._advice
    assert isinstance(advice, JumpStart)
    advice._horizon = 6.0
    ours, theirs = acted(found, 1)
    assert ours[:6] == theirs[:6]
    assert ours[6:] != theirs[6:], "then it explores"
    advice.kappa = 0.5
    assert advice.guide_steps == 3


def test_the_horizon_is_the_length_of_the_sources_own_episodes(source: Knowledge) -> None:
    advice = learner("jsrl", source, task="cartpole:limit=7")._advice
    assert isinstance(advice, JumpStart)
    assert advice.guide_steps == 7


def test_policy_reuse_follows_the_source_with_probability_psi(source: Knowledge) -> None:
    ours, theirs = acted(learner("ppr_dqn", source, nu=1.0, epsilon_start=1.0, replay_capacity=1000), 3)
    assert ours == theirs
    half = acted(learner("ppr_dqn", source, nu=1.0, psi_start=0.5, epsilon_start=1.0, replay_capacity=1000), 8)
    assert 0.6 < np.mean(np.equal(*half)) < 0.9, "of the other half an even share agrees by chance"


def test_policy_reuse_with_psi_0_is_dqn(source: Knowledge) -> None:
    assert returns(begin("ppr_dqn", source, psi_start=0.0)) == returns(begin("dqn", source))


def test_kickstarting_without_weight_is_dqn(source: Knowledge) -> None:
    assert returns(begin("kickstart", source, weight=0.0)) == returns(begin("dqn", source))


def test_kickstarting_makes_q_act_as_the_source_does(source: Knowledge) -> None:
    """Before its weight has faded, in far more states than DQN."""
    shares = []
    for agent, given in (("dqn", {}), ("kickstart", {"weight": 100.0, "temperature": 0.1})):
        found = learner(agent, source, episodes=40, **given)
        found.run(40)
        network, states = learner("es", source)._advice.source, remembered(found)
        assert network is not None
        shares.append(float((found._q.rows(states).argmax(axis=1) == network.rows(states).argmax(axis=1)).mean()))
    assert shares[1] > 0.9
    assert shares[1] > shares[0]


def test_half_of_each_minibatch_is_the_sources(source: Knowledge) -> None:
    found = learner("replay_seed", source)
    seen: list[tuple[F32, F32, F32]] = []
    update = found._q.update

    def spy(observations: F32, actions: Any, targets: F32) -> float:
        seen.append((observations.reshape(4, -1).T.copy(), actions.copy(), targets.copy()))
        return update(observations, actions, targets)

    found._q.update = spy  # type: ignore[method-assign]
    found.run(2)
    prior: Any = found._advice
    theirs, ours = prior._seen, found._replay.memory
    assert len(theirs.actions) == 50
    observations, actions, targets = seen[-1]
    for i in range(8):
        pool, other = (ours, theirs) if i < 4 else (theirs, ours)
        same = (pool.observations == observations[i]).all(axis=1) & (pool.actions == actions[i])
        assert not (other.observations == observations[i]).all(axis=1).any()
        k = int(np.flatnonzero(same)[0])
        future = found._target.rows(pool.next_observations[k : k + 1]).max() * (not pool.terminated[k])
        assert targets[i] == pytest.approx(pool.rewards[k] + 0.99 * future, rel=1e-4)


def test_a_gated_initialisation_begins_as_the_source_and_ends_as_q(source: Knowledge) -> None:
    found = learner("dqinit", source, evaluation_episodes=5, known_after=2)
    network = learner("es", source)._advice.source
    assert network is not None
    theirs = learner("warm_start", source, evaluation_episodes=5)
    assert found.evaluate().greedy_return == theirs.evaluate().greedy_return
    found.run(4)
    advice, states = found._advice, remembered(found)
    assert isinstance(advice, GatedInit)
    known, q = advice.known(states), found._q.rows(states)
    assert known.min() > 0
    assert known.max() == 1
    expected = known[:, None] * q + (1 - known[:, None]) * network.rows(states)
    np.testing.assert_allclose(found.preferences(states), expected, rtol=1e-5)
    np.testing.assert_array_equal(found.preferences(states)[known == 1], q[known == 1])
    assert sum(advice._visits.values()) == found.steps


def test_targets_of_a_gated_initialisation_are_of_the_mixed_values(source: Knowledge) -> None:
    found = learner("dqinit", source)
    found.run(2)
    memory, size = found._replay.memory, found._replay.size
    found._targets.target_copied(size)
    found._targets.refresh(found._replay)
    after = memory.next_observations[:size]
    mixed = found._advice.evaluated(found._target.rows(after), after).max(axis=1) * ~memory.terminated[:size]
    np.testing.assert_allclose(found._targets.td[:size], memory.rewards[:size] + 0.99 * mixed, rtol=1e-5)


def test_a_constant_factor_is_the_mean_of_the_states_own(source: Knowledge) -> None:
    found = learner("constant_es", source)
    found.run(4)
    advice = found._advice
    assert isinstance(advice, ConstantFactor)
    advice.episode(4)
    states = found._remembered_states()
    own = np.exp(-np.abs(advice.delta.rows(states)).max(axis=1))
    assert own.std() > 0
    np.testing.assert_allclose(advice.factor(states[:5]), own.mean(), rtol=1e-5)
    q, q_src = found._q.row(states[0]).copy(), advice.source.row(states[0]).copy()
    expected = int(np.argmax(q + advice.kappa * own.mean() * q_src))
    assert advice.best(q, states[0]) == expected


def test_a_shuffled_factor_is_that_of_another_state(source: Knowledge, monkeypatch: pytest.MonkeyPatch) -> None:
    """Its delta is huge in every remembered state and 0 in this one, whose advice is gone all the same."""
    found = learner("shuffled_es", source)
    found.run(2)
    advice = found._advice
    assert isinstance(advice, ShuffledFactor)
    here = np.array([0.01, 0.02, 0.03, 0.04], np.float32)
    monkeypatch.setattr(advice.delta, "row", lambda s: np.full(2, 0.0 if np.array_equal(s, here) else 80.0, np.float32))
    best = int(advice.source.row(here).argmax())
    q = np.zeros(2, np.float32)
    q[1 - best] = 1e-6
    assert advice.best(q, here) == 1 - best
    monkeypatch.setattr(advice, "_states", here[None])
    assert advice.best(q, here) == best


@pytest.mark.parametrize("task", ["acrobot:link_mass=2", "lunar_lander:mass=1.1", "reacher:y_force=1"])
def test_all_of_them_train_on_the_other_tasks(task: str) -> None:
    given = SMALL | {"episodes": 1, "evaluate_every": 1, "evaluation_episodes": 1}
    origin = train(Cell.create("dqn", f"{task.partition(':')[0]}:limit=40", 0, given))
    list(origin)
    named = Source(task=origin.cell.task, kind="learned", cell_id=origin.cell.id)
    for agent, own in AGENTS.items():
        limited = f"{task},limit=40"
        points = list(train(Cell.create(agent, limited, 0, given | own, named), origin.knowledge()))
        assert all(np.isfinite(point.greedy_return) for point in points)
