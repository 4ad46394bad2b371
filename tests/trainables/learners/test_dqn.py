"""The deep agents: what they learn from, what they report, what they refuse, and that they can be interrupted."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest
import torch

from trainables.agents import registry
from trainables.agents.builtin.dqn import DQN
from trainables.cell import Cell, Source
from trainables.curve import EvalPoint
from trainables.errors import InputError, TrainingError
from trainables.knowledge import Knowledge
from trainables.learners.advice import Advice, DeltaShaping, PotentialAdvice
from trainables.learners.dqn import DeepLearner
from trainables.networks.network import new_network
from trainables.storage import checkpoint
from trainables.tasks.make import make_env
from trainables.tasks.registry import parse_task
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
DEEP = ["dqn", "es", "delta_es", "dpba", "delta_dpba"]
TARGET = "cartpole:gravity=5x"


@pytest.fixture(scope="module")
def source() -> Knowledge:
    training = train(Cell.create("dqn", "cartpole", 0, SMALL))
    assert len(list(training)) == 4
    return training.knowledge()


def cell(agent: str, task: str = TARGET, seed: int = 0, origin: dict[str, Any] | None = None, **given: Any) -> Cell:
    named = Source(task="cartpole", kind="learned", cell_id="0" * 16, **(origin or {}))
    return Cell.create(agent, task, seed, SMALL | given, None if agent == "dqn" else named)


def begin(agent: str, source: Knowledge, **given: Any) -> Training:
    return train(cell(agent, **given), None if agent == "dqn" else source)


def curve(points: Iterator[EvalPoint]) -> list[dict[str, Any]]:
    return [{key: value for key, value in asdict(point).items() if key != "seconds"} for point in points]


@pytest.mark.parametrize("agent", DEEP)
def test_interrupted_twice_and_resumed_is_bit_for_bit_uninterrupted(
    agent: str, source: Knowledge, tmp_path: Path
) -> None:
    whole = begin(agent, source)
    expected = curve(whole)
    points: list[dict[str, Any]] = []
    for part in range(3):
        training = begin(agent, source)
        if part:
            training.restore(checkpoint.load(tmp_path / "state"))
        points += curve(point for _, point in zip(range((1, 2, 9)[part]), training, strict=False))
        checkpoint.save(tmp_path / "state", training.state())
    assert points == expected
    assert training.knowledge().digest == whole.knowledge().digest


@pytest.mark.parametrize("agent", DEEP)
def test_the_same_cell_gives_the_same_bits_and_another_seed_does_not(agent: str, source: Knowledge) -> None:
    first, second, other = (begin(agent, source, seed=seed) for seed in (0, 0, 1))
    assert curve(first) == curve(second)
    assert first.knowledge().digest == second.knowledge().digest
    assert curve(first) != curve(other)


def test_another_process_with_other_thread_settings_gives_the_same_bits(source: Knowledge, tmp_path: Path) -> None:
    here = begin("delta_es", source)
    list(here)
    np.savez(tmp_path / "source.npz", **source.arrays)
    (tmp_path / "cell.json").write_text(json.dumps(here.cell.to_json()))
    code = (
        "import json, sys, numpy as np\n"
        "from trainables.numerics.threads import one_thread\n"
        "from trainables.cell import Cell\n"
        "from trainables.knowledge import Knowledge\n"
        "from trainables.training.train import train\n"
        "one_thread()\n"
        "cell = Cell.from_json(json.load(open('cell.json')))\n"
        "training = train(cell, Knowledge(dict(np.load('source.npz'))))\n"
        "list(training); print(training.knowledge().digest)"
    )
    environment = os.environ | {"PYTHONPATH": os.getcwd(), "OMP_NUM_THREADS": "1"}
    done = subprocess.run(
        [sys.executable, "-c", code], cwd=tmp_path, env=environment, capture_output=True, text=True, check=True
    )
    assert done.stdout.strip() == here.knowledge().digest


@pytest.mark.parametrize("agent", DEEP)
def test_what_is_reported(agent: str, source: Knowledge) -> None:
    points = list(begin(agent, source))
    assert [point.episode for point in points] == [0, 4, 8, 12]
    assert points[0].training_return is None
    last = points[-1].statistics
    names = {"epsilon", "loss"}
    if agent != "dqn":
        names |= {"kappa", "advice_factor", "advised_factor", "delta_sample_median"}
    if agent.startswith("delta"):
        names |= {"delta_mean", "delta_median", "delta_p90", "advised_delta"}
        names |= {"delta_rests"} if agent == "delta_es" else set()
        assert 0 < last["delta_median"] <= last["delta_p90"]
    assert set().union(*(point.statistics for point in points[1:])) == names
    assert points[-1].step == sum(
        round(point.training_return * 4) for point in points[1:] if point.training_return is not None
    )


def test_kappa_is_zero_after_the_fraction_of_the_sources_steps(source: Knowledge) -> None:
    assert int(source.arrays["steps"]) > 100
    points = list(begin("es", source, advice_fraction=0.5, origin={"steps": 160}))
    for point in points:
        assert point.statistics["kappa"] == pytest.approx(max(0.0, 1 - point.step / 80), abs=1e-9)
    assert points[-1].statistics["kappa"] == 0.0


def test_without_advice_left_es_acts_as_dqn_does(source: Knowledge) -> None:
    """Kappa is 0 after one step, and that step explores: from then on nothing differs."""
    plain = curve(begin("dqn", source, epsilon_start=1.0))
    advised = curve(begin("es", source, origin={"steps": 1}, advice_fraction=1.0, epsilon_start=1.0))
    assert [point["greedy_return"] for point in advised] == [point["greedy_return"] for point in plain]


def learner(agent: str, source: Knowledge, **given: Any) -> DeepLearner:
    made = cell(agent, **given)
    found = DeepLearner(made, None if agent == "dqn" else source)
    found.run(6)
    return found


def test_targets_are_the_target_networks_of_now(source: Knowledge) -> None:
    """The cached targets equal those computed afresh: r + gamma max_b Q_target(s',b), 0 if terminal."""
    agent = learner("dqn", source)
    memory, settings = agent._replay.memory, agent._settings
    for _ in range(5):
        batch = agent._replay.sample(agent._targets)
        i = batch.indices
        future = agent._target.rows(memory.next_observations[i]).max(axis=1) * ~memory.terminated[i]
        np.testing.assert_allclose(batch.td_targets, memory.rewards[i] + settings.gamma * future, rtol=1e-5)
        np.testing.assert_array_equal(batch.observations.reshape(4, -1).T, memory.observations[i])
        np.testing.assert_array_equal(batch.actions, memory.actions[i])


def test_delta_learns_from_equation_4(source: Knowledge) -> None:
    agent = learner("delta_es", source, delta_after_advice="train")
    memory, i = agent._replay.memory, np.arange(agent._replay.size)
    agent._targets.refresh(agent._replay)
    network = agent._advice.source
    assert network is not None
    v_src = network.rows(memory.next_observations[i]).max(axis=1) * ~memory.terminated[i]
    q_src = network.rows(memory.observations[i])[i, memory.actions[i]]
    np.testing.assert_allclose(agent._targets.delta[i], memory.rewards[i] + 0.99 * v_src - q_src, atol=1e-5)


@pytest.mark.parametrize("agent_name", ["dpba", "delta_dpba"])
def test_potential_advice_shapes_the_target(agent_name: str, source: Knowledge) -> None:
    """The target is r + gamma max_b (Q + Phi)(s',b) - Phi(s,a), with Phi the source's scaled advantage."""
    agent = learner(agent_name, source)
    memory, i = agent._replay.memory, np.arange(agent._replay.size)
    agent._targets.target_copied(agent._replay.size)
    agent._targets.refresh(agent._replay)
    advice = agent._advice
    assert isinstance(advice, PotentialAdvice)
    potential = advice.rows(memory.observations[i])
    assert potential.max() == 0 > potential.min()
    later = agent._target.rows(memory.next_observations[i]) + advice.rows(memory.next_observations[i])
    expected = memory.rewards[i] - potential[i, memory.actions[i]] + 0.99 * later.max(axis=1) * ~memory.terminated[i]
    np.testing.assert_allclose(agent._targets.td[i], expected, rtol=1e-5)


def test_delta_rests_once_the_advice_has_ended_and_every_bit_of_q_is_the_same(source: Knowledge) -> None:
    given: dict[str, Any] = {"origin": {"steps": 160}, "advice_fraction": 0.5}
    rests, trains = (begin("delta_es", source, delta_after_advice=choice, **given) for choice in ("rest", "train"))
    rested, trained = list(rests), list(trains)
    assert rests.knowledge().digest == trains.knowledge().digest
    assert [p.greedy_return for p in rested] == [p.greedy_return for p in trained]
    ended = [p.statistics for p in rested if p.statistics["kappa"] == 0.0]
    assert len(ended) >= 2
    assert all(statistics["delta_rests"] == 1.0 for statistics in ended)
    assert len({statistics["delta_p90"] for statistics in ended}) == 1
    assert rested[0].statistics["delta_rests"] == 0.0
    assert "delta_rests" not in trained[-1].statistics
    assert trained[-1].statistics["delta_p90"] != ended[-1]["delta_p90"]


def test_a_cell_from_before_delta_could_rest_keeps_its_id_and_what_it_means() -> None:
    now, then = cell("delta_es"), cell("delta_es", delta_after_advice="train")
    assert now.to_json()["hyperparameters"]["delta_after_advice"] == "rest"
    assert "delta_after_advice" not in then.to_json()["hyperparameters"]
    assert len({now.id, then.id}) == len({now.group, then.group}) == 2
    assert Cell.from_json(then.to_json()) == then
    assert Cell.from_json(then.to_json()).hyperparameters["delta_after_advice"] == "train"
    assert Cell.from_json(now.to_json()) == now


def test_the_loss_of_delta_is_that_of_equation_4_whatever_that_of_q_is(source: Knowledge) -> None:
    network = learner("delta_es", source, loss="huber")._delta
    assert network is not None
    x, actions, targets = np.zeros(4 * 8, np.float32), np.zeros(8, np.int64), np.full(8, 100.0, np.float32)
    error = 100.0 - network.row(np.zeros(4, np.float32))[0]
    assert network.update(x, actions, targets) == pytest.approx(error**2, rel=1e-4)


class Plain(DQN):
    """Settings of a custom agent that are DQN's."""


def test_a_custom_deep_agent_with_a_source_has_the_advice_that_its_settings_name_and_else_none(
    source: Knowledge, monkeypatch: pytest.MonkeyPatch
) -> None:
    class Advised(Plain):
        advice = PotentialAdvice

    for settings, expected in ((Plain, Advice), (Advised, PotentialAdvice)):
        agent = replace(registry.AGENTS["es"], hyperparameters=settings)
        monkeypatch.setitem(registry.AGENTS, "es", agent)
        found = DeepLearner(cell("es"), source)
        assert type(found._advice) is expected
        found.run(6)
        assert found._advice.kappa == (expected is PotentialAdvice)


def test_advice_follows_equation_5(source: Knowledge) -> None:
    agent = learner("delta_es", source)
    network = agent._advice.source
    assert isinstance(agent._advice, DeltaShaping)
    assert network is not None
    assert agent._delta is not None
    agent._advice.kappa = 0.7
    for state in agent._replay.memory.observations[:20]:
        q_src, delta, q = network.row(state).copy(), agent._delta.row(state).copy(), agent._q.row(state).copy()
        advice = 0.7 * np.exp(-np.abs(delta).max()) * (q_src - q_src.max())
        np.testing.assert_allclose(agent._advice.rows(state[None])[0], advice, rtol=1e-4, atol=1e-6)
        assert agent._advice.best(q, state) == int(np.argmax(q + advice))


def test_the_best_evaluated_network_is_kept(source: Knowledge) -> None:
    training = begin("dqn", source)
    seen = [(point.greedy_return, training.knowledge().arrays["last"]) for point in training]
    best = max(value for value, _ in seen)
    knowledge = training.knowledge().arrays
    assert float(knowledge["best_return"]) == best
    assert any(value == best and np.array_equal(knowledge["best"], vector) for value, vector in seen)


def test_advice_comes_from_the_checkpoint_that_is_named(source: Knowledge) -> None:
    arrays = dict(source.arrays) | {"best": -source.arrays["last"]}
    last, best = (
        curve(begin("es", Knowledge(arrays), origin={"checkpoint": name, "steps": 10_000})) for name in ("last", "best")
    )
    assert last != best


def test_epsilon_counts_episodes_or_steps(source: Knowledge) -> None:
    by_episodes = list(begin("dqn", source))[-1]
    by_steps = list(begin("dqn", source, epsilon_unit="steps"))[-1]
    assert by_episodes.statistics["epsilon"] == pytest.approx(0.01 + 0.29 * np.exp(-12 / 500))
    assert by_steps.statistics["epsilon"] == pytest.approx(0.01 + 0.29 * np.exp(-by_steps.step / 500))


@pytest.mark.parametrize("truncation", ["bootstrap", "terminal"])
def test_truncation_cuts_the_bootstrap_of_q_only_where_asked_and_never_that_of_delta(
    truncation: str, source: Knowledge
) -> None:
    agent = learner("delta_es", source, task="cartpole:limit=5", truncation=truncation, origin={"steps": 10_000})
    memory, size = agent._replay.memory, agent._replay.size
    assert memory.cut[:size].any() == (truncation == "terminal")
    assert not memory.terminated[:size].any()
    agent._targets.refresh(agent._replay)
    network, last = agent._advice.source, np.flatnonzero(np.arange(size) % 5 == 4)
    assert network is not None
    v_src = network.rows(memory.next_observations[last]).max(axis=1)
    q_src = network.rows(memory.observations[last])[np.arange(len(last)), memory.actions[last]]
    np.testing.assert_allclose(agent._targets.delta[last], memory.rewards[last] + 0.99 * v_src - q_src, atol=1e-5)


@pytest.mark.parametrize(
    ("given", "says"),
    [
        ({"advice_fraction": 0.0}, "advice_fraction"),
        ({"advice_fraction": 1.5}, "advice_fraction"),
        ({"batch_size": 200}, "batch_size 200 must be at most replay_capacity 150"),
        ({"loss": "hinge"}, "loss"),
        ({"learning_rate": float("nan")}, "learning_rate"),
    ],
)
def test_bad_hyperparameters_are_refused_with_one_sentence(given: dict[str, Any], says: str) -> None:
    with pytest.raises(InputError, match=says) as caught:
        cell("es", **given)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("change", "says"),
    [
        ({"sizes": np.array([6, 16, 16, 3])}, "6 inputs and 3 actions, but the target task has 4 and 2"),
        ({"last": np.zeros(3, np.float32)}, "has 3 parameters"),
        ({"last": np.full(386, np.nan, np.float32)}, "NaN"),
        ({"sizes": None}, "not the knowledge of a deep agent"),
    ],
)
def test_a_source_that_does_not_fit_is_refused(change: dict[str, Any], says: str, source: Knowledge) -> None:
    arrays = {key: value for key, value in (dict(source.arrays) | change).items() if value is not None}
    with pytest.raises(InputError, match=says):
        begin("es", Knowledge(arrays))


def test_a_source_run_without_steps_is_refused(source: Knowledge) -> None:
    with pytest.raises(InputError, match="at least one step"):
        begin("es", source, origin={"steps": 0})


def test_a_source_with_other_hidden_layers_fits(source: Knowledge) -> None:
    assert len(list(begin("delta_es", source, hidden_size=24))) == 4


def test_divergence_fails_the_cell_with_step_and_cause(source: Knowledge) -> None:
    agent = learner("dqn", source)
    agent._q.load_vector(np.full_like(agent._q.vector(), np.nan))
    with pytest.raises(TrainingError, match=r"loss is nan at step \d+ .*values diverged"):
        agent.run(3)


def test_an_environments_nan_fails_the_cell_with_the_cause(source: Knowledge, monkeypatch: pytest.MonkeyPatch) -> None:
    agent = learner("dqn", source)
    observation = np.array([np.nan, 0, 0, 0], np.float32)
    monkeypatch.setattr(agent, "_loop", None)
    monkeypatch.setattr(agent, "_late_loop", None)
    monkeypatch.setattr(agent._env, "step", lambda action: (observation, 1.0, False, False))
    with pytest.raises(TrainingError, match=r"environment returned .*observations that are not finite"):
        agent.run(1)


def tiny_module(inputs: int, actions: int) -> torch.nn.Module:
    return torch.nn.Sequential(torch.nn.Linear(inputs, 8), torch.nn.Tanh(), torch.nn.Linear(8, actions))


@pytest.mark.parametrize("agent", ["dqn", "delta_es"])
def test_a_custom_module_trains_and_resumes(agent: str, tmp_path: Path) -> None:
    module = f"{__name__}:tiny_module"
    origin = train(Cell.create("dqn", "cartpole", 0, SMALL | {"module": module}))
    list(origin)
    whole = begin(agent, origin.knowledge(), module=module)
    expected = curve(whole)
    halted, resumed = (begin(agent, origin.knowledge(), module=module) for _ in range(2))
    points = curve(point for _, point in zip(range(2), halted, strict=False))
    checkpoint.save(tmp_path / "state", halted.state())
    resumed.restore(checkpoint.load(tmp_path / "state"))
    assert points + curve(resumed) == expected
    assert resumed.knowledge().digest == whole.knowledge().digest


def test_a_module_is_computed_by_one_thread_whoever_trains_it() -> None:
    """The sums of several threads are others, so that a replay would not agree with its worker."""
    before = torch.get_num_threads()
    torch.set_num_threads(2)
    try:
        train(Cell.create("dqn", "cartpole", 0, SMALL | {"module": f"{__name__}:tiny_module"}))
        assert torch.get_num_threads() == 1
    finally:
        torch.set_num_threads(before)


def random_module(inputs: int, actions: int) -> torch.nn.Module:
    """A module that draws a parameter of its own."""
    module = torch.nn.Sequential(torch.nn.Linear(inputs, actions))
    module.register_parameter("noise", torch.nn.Parameter(torch.randn(3)))
    return module


def test_what_a_custom_module_draws_comes_from_the_cells_stream() -> None:
    digests = []
    for _ in range(2):
        torch.randn(1)
        training = train(Cell.create("dqn", "cartpole", 0, SMALL | {"module": f"{__name__}:random_module"}))
        digests.append(training.knowledge().digest)
    assert digests[0] == digests[1]


def test_any_discrete_gymnasium_task_trains() -> None:
    for task in ("gym:MountainCar-v0:gravity=2x", "gym:FrozenLake-v1"):
        points = list(train(Cell.create("dqn", task, 0, SMALL | {"episodes": 2, "evaluate_every": 2})))
        assert len(points) == 2


@pytest.mark.parametrize("task", ["acrobot:link_mass=2", "lunar_lander:mass=1.1", "reacher:y_force=1"])
def test_the_other_tasks_train(task: str) -> None:
    given = SMALL | {"episodes": 2, "evaluate_every": 2}
    origin = train(Cell.create("dqn", task.partition(":")[0], 0, given))
    list(origin)
    named = Source(task=origin.cell.task, kind="learned", cell_id=origin.cell.id)
    points = list(train(Cell.create("delta_es", task, 0, given, named), origin.knowledge()))
    assert all(np.isfinite(point.greedy_return) for point in points)


def test_evaluation_equals_one_episode_after_the_other(source: Knowledge) -> None:
    agent = learner("dqn", source, evaluation_episodes=5)
    state = agent.state()["rngs"]["evaluation_env"]
    point = agent.evaluate()
    rng = np.random.default_rng()
    rng.bit_generator.state = state
    total = 0.0
    for seed in [int(rng.integers(2**31)) for _ in range(5)]:
        env: gymnasium.Env[Any, Any] = make_env(parse_task(TARGET))
        observation, done = env.reset(seed=seed)[0], False
        while not done:
            action = int(agent._q.rows(observation[None])[0].argmax())
            observation, reward, terminated, truncated, _ = env.step(action)
            total += float(reward)
            done = terminated or truncated
    assert point.greedy_return == total / 5


def test_evaluation_never_disturbs_training(source: Knowledge) -> None:
    often, seldom = begin("dqn", source, evaluate_every=1), begin("dqn", source, evaluate_every=12)
    list(often)
    list(seldom)
    np.testing.assert_array_equal(often.knowledge().arrays["last"], seldom.knowledge().arrays["last"])


def test_a_network_without_a_generator_is_a_blank_of_the_same_shape() -> None:
    settings = cell("dqn").settings
    assert not new_network(settings, 4, 2, 1.0).vector().any()  # type: ignore[arg-type]
