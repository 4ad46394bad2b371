"""The Gymnasium environments of the tabular tasks, and their agreement with the exact models."""

from __future__ import annotations

import warnings

import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env
from gymnasium.wrappers import TimeLimit

from trainables.tasks.make import make_env
from trainables.tasks.registry import model_of, parse_task
from trainables.tasks.tabular_env import step

TASKS = ("windy_gridworld", "windy_gridworld:wind=additional_2", "supply_chain", "supply_chain:demand_mean=5")


@pytest.mark.parametrize("task", TASKS)
def test_the_environment_passes_gymnasiums_checker_without_a_warning(task: str) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        check_env(make_env(parse_task(task)).unwrapped, skip_render_check=True)


@pytest.mark.parametrize("task", ["windy_gridworld", "supply_chain"])
def test_an_episode_is_truncated_after_200_steps_and_not_terminated(task: str) -> None:
    env = make_env(parse_task(task))
    assert isinstance(env, TimeLimit)
    env.reset(seed=0)
    ends = [env.step(0)[2:4] for _ in range(200)]  # up for ever; no production for ever
    assert ends == [(False, False)] * 199 + [(False, True)]


def test_the_environment_is_seeded_by_reset() -> None:
    env = make_env(parse_task("windy_gridworld"))

    def walk(seed: int) -> list[int]:
        env.reset(seed=seed)
        return [env.step(3)[0] for _ in range(50)]

    assert walk(0) == walk(0)
    assert walk(0) != walk(1)


@pytest.mark.parametrize("task", TASKS)
def test_model_rows_are_probabilities_and_terminal_rows_are_empty(task: str) -> None:
    model = model_of(task)
    actions = model.rewards.shape[1]
    sums = np.asarray(model.transitions.sum(axis=1)).reshape(-1, actions)
    assert np.abs(sums[~model.terminal] - 1).max() < 1e-12
    assert model.transitions.data.min() >= 0
    assert (sums[model.terminal] == 0).all()
    assert (model.rewards[model.terminal] == 0).all()
    goal = 17 * 20 + 14
    assert list(np.flatnonzero(model.terminal)) == ([goal] if task.startswith("windy") else [])


@pytest.mark.parametrize("task", TASKS)
def test_sampled_steps_agree_with_the_exact_model(task: str) -> None:
    model, dynamics, rng = model_of(task), parse_task(task).dynamics(), np.random.default_rng(7)
    live = np.flatnonzero(~model.terminal)
    draws = 2000
    for _ in range(12):
        state, action = int(rng.choice(live)), int(rng.integers(dynamics.actions))
        steps = [step(dynamics.kind, state, action, dynamics.parameters, rng) for _ in range(draws)]
        row = model.transitions[[state * dynamics.actions + action]].toarray()[0]
        seen = np.bincount([s[0] for s in steps], minlength=dynamics.states) / draws
        assert (np.abs(seen - row) <= 5 * np.sqrt(row * (1 - row) / draws) + 5 / draws).all()
        assert [s[2] for s in steps] == [bool(model.terminal[s[0]]) for s in steps]
        rewards = np.array([s[1] for s in steps])
        assert abs(rewards.mean() - model.rewards[state, action]) <= 5 * rewards.std() / np.sqrt(draws) + 1e-9
