"""Custom tasks and agents at work: features, exact models, packages, and each way in which custom code can be wrong."""

from __future__ import annotations

import sys
import types
from importlib.metadata import EntryPoint
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest
from scipy.sparse import csr_array

from trainables.agents.hyperparameters import QLearning
from trainables.agents.registry import agent_named, agents
from trainables.cell import Cell, Source
from trainables.custom import agent, feature, load, tabular_task, task
from trainables.delta.exact import exact_q
from trainables.errors import InputError
from trainables.learners.step_learner import StepLearner
from trainables.plugins import entry_points
from trainables.tasks.env_checker import check, rollout
from trainables.tasks.make import make_env
from trainables.tasks.registry import all_families, families, parse_task
from trainables.tasks.spec.tabular_model import TransitionModel
from trainables.training.cell_run import run_cell

HERE = Path(__file__).parent
SMALL = {"episodes": 4, "evaluate_every": 2, "evaluation_episodes": 2, "hidden_size": 8, "batch_size": 8}


def chain(slip: float = 0.1) -> TransitionModel:
    """Five states in a row, right or left; the last ends the episode."""
    p, rewards = np.zeros((10, 5)), np.full((5, 2), -1.0)
    for state in range(4):
        for action, aim in enumerate((state + 1, max(state - 1, 0))):
            p[2 * state + action, aim] += 1 - slip
            p[2 * state + action, state] += slip
    rewards[4] = 0.0
    return TransitionModel(csr_array(p), rewards, 0, 50)


CHAIN = """
import sys
sys.path.insert(0, {here!r})
from test_custom_tasks import chain
from trainables.custom import feature, tabular_task
Task = tabular_task(chain, feature("slip", 0.1, 0, 0.9), episodes=200, targets=("slip=0.5",))
"""


@pytest.fixture
def chain_task(tmp_path: Path) -> str:
    (tmp_path / "chain.py").write_text(CHAIN.format(here=str(HERE)))
    return load(f"{tmp_path / 'chain.py'}:Task")


def failure(name: str) -> str:
    """Why a short cell of a task in bad_tasks.py fails."""
    outcome = run_cell(Cell.create("dqn", load(f"{HERE / 'bad_tasks.py'}:{name}"), 0, SMALL), lambda cell: None)
    return str(outcome.error)


# --- features --------------------------------------------------------------------------------------------------


def test_features_reach_the_environment_by_name_and_the_limit_truncates() -> None:
    name = load(f"{HERE / 'bad_tasks.py'}:Good:wind=0.25,limit=3")
    env = make_env(parse_task(name))
    assert env.unwrapped.wind == 0.25  # type: ignore[attr-defined]
    env.reset(seed=0)
    assert [env.step(0)[3] for _ in range(3)] == [False, False, True]
    with pytest.raises(InputError, match="wind must be a number between -1 and 1"):
        parse_task(f"{name.partition(':wind')[0]}:wind=2")


def test_a_time_limit_inside_other_wrappers_is_one(tmp_path: Path) -> None:
    (tmp_path / "wrapped.py").write_text(
        "import gymnasium\nfrom trainables.custom import task\n\n\ndef build():\n"
        "    return gymnasium.wrappers.FlattenObservation(gymnasium.make('CartPole-v1', max_episode_steps=3))\n\n\n"
        "Task = task(build)\n"
    )
    env = make_env(parse_task(load(f"{tmp_path / 'wrapped.py'}:Task")))
    env.reset(seed=0)
    assert [env.step(0)[3] for _ in range(3)] == [False, False, True]


def test_continuous_actions_of_a_custom_task_are_cut_into_levels() -> None:
    task = parse_task(load(f"{HERE / 'bad_tasks.py'}:Cut:levels=5"))
    assert make_env(task).action_space == gymnasium.spaces.Discrete(5)


@pytest.mark.parametrize(
    ("features", "more", "says"),
    [
        (("mass",), {}, r"Walk cannot be called with the features mass: got an unexpected"),
        (("wind", "wind"), {}, "the name 'wind' of a feature is already taken"),
        (("limit",), {"limit": 5}, "the name 'limit' of a feature is already taken"),
    ],
)
def test_features_that_do_not_fit_are_refused_when_the_task_is_made(
    features: tuple[str, ...], more: dict[str, Any], says: str
) -> None:
    class Walk(gymnasium.Env):  # type: ignore[type-arg]
        def __init__(self, wind: float = 0.0, limit: float = 0.0) -> None: ...

    with pytest.raises(InputError, match=says):
        task(Walk, *(feature(name, 0.0, -1, 1) for name in features), **more)
    with pytest.raises(InputError, match=r"the default must be between 0 and 1 \(got 3\)"):
        feature("wind", 3, 0, 1)


# --- custom code that is wrong -------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("name", "says", "line"),
    [
        ("Reset", "RuntimeError: the simulator is not there", 'raise RuntimeError("the simulator'),
        (
            "Shape",
            "the observation has shape (3,), its space says (2,)",
            "def step(self, action):\n        observation, *rest",
        ),
        ("Nan", "the reward is nan, not a finite number", "def step(self, action):\n        observation, _"),
        ("Multi", "only Discrete and Box actions can be learned, not MultiDiscrete([2 2])", "def __init__"),
        ("Torque", "its actions are continuous (Box(-1.0, 1.0, (1,), float32)): declare levels=3", "def __init__"),
        ("Words", "its observations are not vectors of a fixed length", "def __init__"),
        ("Endless", "its episodes have no time limit: declare limit=200", "def __init__"),
    ],
)
@pytest.mark.filterwarnings("ignore:invalid value")
def test_each_broken_promise_fails_the_cell_with_a_sentence_and_the_line(name: str, says: str, line: str) -> None:
    text = (HERE / "bad_tasks.py").read_text()
    error = failure(name)
    assert says in error
    assert error.endswith(f"(bad_tasks.py:{text[: text.index(line)].count(chr(10)) + 1})")
    assert "\n" not in error


def test_check_finds_a_feature_that_does_nothing_and_passes_the_others() -> None:
    found = {finding.question: finding.passed for finding in check(parse_task(load(f"{HERE / 'bad_tasks.py'}:Good")))}
    assert found.pop("idle acts") is False
    assert set(found.values()) == {True}


def test_check_logs_where_a_tasks_code_has_failed(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    text = (HERE / "bad_tasks.py").read_text() + (
        "class Broken(Walk):\n    def step(self, action):\n        raise RuntimeError('lost the map')\n\n\n"
        "Lost = made(Broken)\n"
    )
    (tmp_path / "lost.py").write_text(text)
    with caplog.at_level("INFO", "deltatune"):
        found = list(check(parse_task(load(f"{tmp_path / 'lost.py'}:Lost"))))
    assert [finding.passed for finding in found] == [False]
    assert "lost the map" in found[0].answer
    assert "the check 'builds and steps' raised an error" in caplog.text
    assert "in step" in caplog.text


def test_check_finds_a_default_that_is_not_the_environments_and_noise_that_has_no_seed(tmp_path: Path) -> None:
    text = (HERE / "bad_tasks.py").read_text() + (
        "class Noisy(Walk):\n    def step(self, action):\n        self.x += np.random.default_rng().random()\n"
        "        return super().step(action)\n\n\n"
        'Off = task(Walk, feature("wind", 0.2, -1, 1), limit=20)\nNoise = made(Noisy)\n'
    )
    (tmp_path / "more.py").write_text(text)
    off = {f.question: f.passed for f in check(parse_task(load(f"{tmp_path / 'more.py'}:Off")))}
    assert off["the default is the plain environment, bit for bit"] is False
    noise = {f.question: f.passed for f in check(parse_task(load(f"{tmp_path / 'more.py'}:Noise")))}
    assert noise["the same seed gives the same rollout"] is False


# --- tabular tasks by their model --------------------------------------------------------------------------------


def test_a_task_by_its_model_passes_every_check(chain_task: str) -> None:
    findings = list(check(parse_task(chain_task)))
    assert [finding for finding in findings if not finding.passed] == []
    assert [finding.question for finding in findings][-1] == "slip acts"


def test_steps_are_drawn_with_the_models_probabilities(chain_task: str) -> None:
    env = make_env(parse_task(f"{chain_task}:slip=0.3"))
    stayed = []
    for seed in range(2000):
        env.reset(seed=seed)
        stayed.append(env.step(0)[0] == 0)
    assert np.mean(stayed) == pytest.approx(0.3, abs=0.05)


def test_every_tabular_agent_learns_a_task_by_its_model(chain_task: str) -> None:
    outcome = run_cell(Cell.create("q_learning", chain_task, 0), lambda cell: None)
    assert outcome.error is None
    best = float(exact_q(chain_task, 0.99)[0].max())
    assert outcome.points["discounted_return"][-1] == pytest.approx(best, rel=1e-6)
    source = Source(task=chain_task, kind="exact")
    for name in ("delta_gate", "policy_reuse"):
        from trainables.training.source_knowledge import exact_source

        cell = Cell.create(name, f"{chain_task}:slip=0.5", 0, {"episodes": 20}, source)
        assert run_cell(cell, lambda cell: exact_source(chain_task, 0.99)).error is None


@pytest.mark.parametrize(
    ("change", "says"),
    [
        (lambda m: TransitionModel(m.transitions * 2, m.rewards, 0, 50), "state 0, action 0 add up to 2, not 1"),
        (lambda m: TransitionModel(m.transitions, m.rewards * np.nan, 0, 50), "a reward is not finite"),
        (lambda m: TransitionModel(m.transitions, m.rewards, 4, 50), r"does not end the episode \(got 4\)"),
        (lambda m: TransitionModel(m.transitions, m.rewards[:, :1], 0, 50), r"transitions must be \(5, 5\)"),
        (lambda m: 3, r"a model must be a TransitionModel \(got 3\)"),
    ],
)
def test_a_model_that_is_none_is_refused(change: Any, says: str) -> None:
    family = tabular_task(lambda slip=0.1: change(chain(slip)), feature("slip", 0.1, 0, 1))
    assert family.model is not None
    with pytest.raises(InputError, match=says):
        family.model({"slip": 0.1})


# --- agents ------------------------------------------------------------------------------------------------------


def test_the_step_learner_is_q_learning(chain_task: str) -> None:
    """The same algorithm as the compiled loop: both reach the exact values on a task without noise."""
    cell = Cell.create("q_learning", f"{chain_task}:slip=0", 0, {"epsilon_start": 0.5, "epsilon_decay": 0.0})
    learner = StepLearner(cell, None)
    learner.run(300)
    reached = exact_q(f"{chain_task}:slip=0", 0.99)
    assert learner.q[:4] == pytest.approx(reached[:4], abs=1e-6)
    assert learner.evaluate().greedy_return == -4


def test_a_deep_agent_may_derive_from_ours(tmp_path: Path) -> None:
    (tmp_path / "deep.py").write_text(
        "from trainables.learners.dqn import DeepLearner\nfrom trainables.agents.hyperparameters import DQN\n"
        "from trainables.custom import agent\n\n\nclass Mine(DeepLearner):\n    '''Mine.'''\n\n\n"
        "Agent = agent(Mine, DQN, kind='deep')\n"
    )
    name = load(f"{tmp_path / 'deep.py'}:Agent")
    own, ours = (run_cell(Cell.create(each, "cartpole", 0, SMALL), lambda cell: None) for each in (name, "dqn"))
    assert own.error is None
    assert own.digest == ours.digest


@pytest.mark.parametrize(
    ("learner", "settings", "says"),
    [
        (type("Lazy", (), {"run": print, "evaluate": print}), QLearning, "the learner Lazy has no method knowledge"),
        (StepLearner, dict, "hyperparameters must be a class derived from Hyperparameters"),
    ],
)
def test_an_agent_that_is_none_is_refused(learner: type, settings: Any, says: str) -> None:
    with pytest.raises(InputError, match=says):
        agent(learner, settings)


def test_hyperparameters_of_a_type_that_cannot_be_checked_are_refused_when_the_agent_is_made(tmp_path: Path) -> None:
    """Not by the first cell, though the checks of a class are built when it is first used."""
    (tmp_path / "odd.py").write_text(
        "from trainables.agents.hyperparameters import QLearning\nfrom trainables.custom import agent\n"
        "from trainables.learners.step_learner import StepLearner\n\n\nclass Thing:\n    pass\n\n\n"
        "class Odd(QLearning):\n    thing: Thing = Thing()\n\n\nAgent = agent(StepLearner, Odd)\n"
    )
    with pytest.raises(InputError, match=r"odd\.py:14: PydanticSchemaGenerationError"):
        load(f"{tmp_path / 'odd.py'}:Agent")


def test_an_agents_name_says_where_it_is_from_and_bad_ones_are_refused(tmp_path: Path) -> None:
    (tmp_path / "mine.py").write_text(
        "from trainables.agents.hyperparameters import QLearning, Transfer\n"
        "from trainables.learners.step_learner import StepLearner\nfrom trainables.custom import agent\n"
        "Plain = agent(StepLearner, QLearning)\nMore = agent(StepLearner, Transfer, base='mine.py:Plain')\nThree = 3\n"
    )
    more = load(f"{tmp_path / 'mine.py'}:More")
    assert agent_named(more).base == load(f"{tmp_path / 'mine.py'}:Plain")
    with pytest.raises(InputError, match=r"mine\.py:Three is not an agent \(it is 3\)"):
        agent_named(load(f"{tmp_path / 'mine.py'}:Three"))
    with pytest.raises(InputError, match="needs a tabular task"):
        Cell.create(load(f"{tmp_path / 'mine.py'}:Plain"), "cartpole", 0)


# --- installed packages ------------------------------------------------------------------------------------------


class Package:
    """Stands for the distribution of an installed package."""

    name, version = "valleys", "1.2"


@pytest.fixture
def package(monkeypatch: pytest.MonkeyPatch) -> Any:
    """Register entry points of a package that is not really installed."""
    module = types.ModuleType("valleys_of_a_test")
    module.TASK = tabular_task(chain, feature("slip", 0.1, 0, 0.9), targets=("slip=0.5",))  # type: ignore[attr-defined]
    module.AGENT = agent(StepLearner, QLearning)  # type: ignore[attr-defined]
    monkeypatch.setitem(sys.modules, module.__name__, module)

    def register(kind: str, name: str, attribute: str) -> None:
        point = EntryPoint(name, f"{module.__name__}:{attribute}", f"deltatune.{kind}s")
        vars(point)["dist"] = Package
        monkeypatch.setattr(entry_points, "_points", lambda asked: (point,) if asked == kind else ())

    families.cache_clear()
    yield register
    families.cache_clear()


def test_a_packages_task_is_named_with_the_version(package: Any) -> None:
    package("task", "valley", "TASK")
    task = parse_task("valley:slip=0.5")
    assert task.name == "valley@1.2:slip=0.5"
    assert parse_task(task.name).name == task.name
    assert rollout(make_env(parse_task(task.name)), 9) == rollout(make_env(task), 9)
    assert [family.targets for family in all_families()][-1] == ("valley@1.2:slip=0.5",)
    with pytest.raises(InputError, match=r"needs the package that registers 'valley' in version 1\.1"):
        make_env(parse_task("valley@1.1:slip=0.5"))


def test_a_packages_agent_is_named_with_the_version(package: Any) -> None:
    package("agent", "walker", "AGENT")
    assert agent_named("walker").name == agent_named("walker@1.2").name == "walker@1.2"
    assert "walker" in agents()
    assert Cell.create("walker", "windy_gridworld", 0).agent == "walker@1.2"


def test_a_name_already_taken_and_a_package_that_cannot_be_imported_are_one_sentence(package: Any) -> None:
    package("task", "cartpole", "TASK")
    with pytest.raises(
        InputError, match="the package 'valleys' registers the task 'cartpole', a name already taken by"
    ):
        parse_task("windy_gridworld:wind=[1,0,0,0,0,0,0,0,0,0,0,0,0,0,0,0,0,0,0,0]")
    package("agent", "dqn", "AGENT")
    with pytest.raises(InputError, match="the agent 'dqn', a name already taken by deltatune itself"):
        agents()
    package("agent", "runner", "NOTHING")
    with pytest.raises(InputError, match="the agent 'runner' of 'valleys' cannot be imported: AttributeError"):
        agent_named("runner")
