"""Whoever builds an environment to look at it closes it: a simulator may hold a window, a process or a port."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import closing
from typing import Any

import gymnasium
import numpy as np
import pytest

from trainables.delta.noise_floor import self_delta
from trainables.errors import InputError
from trainables.source_ranking.deep import DeepComparison
from trainables.tasks import env_checker, gymnasium_task, rollout
from trainables.tasks.registry import parse_task


class Held:
    """The environments that were built and are not closed."""

    def __init__(self) -> None:
        self.names: dict[int, str] = {}
        self.built = 0

    def noting(self, make: Callable[..., gymnasium.Env]) -> Callable[..., gymnasium.Env]:
        """Return `make`, noted down."""

        def noted(*words: Any) -> gymnasium.Env:
            env = make(*words)
            self.built += 1
            inner = env.unwrapped
            self.names[id(inner)] = str(env)
            close = inner.close

            def closed() -> None:
                self.names.pop(id(inner), None)
                close()

            inner.close = closed  # type: ignore[method-assign]
            return env

        return noted


@pytest.fixture
def held(monkeypatch: pytest.MonkeyPatch) -> Held:
    held = Held()
    for module in (env_checker, rollout):
        monkeypatch.setattr(module, "make_env", held.noting(module.make_env))
    monkeypatch.setattr(gymnasium_task, "_make", held.noting(gymnasium_task._make))
    monkeypatch.setattr(env_checker, "STEPS", 20)
    return held


@pytest.mark.parametrize("name", ["cartpole", "windy_gridworld", "gym:MountainCar-v0:gravity=0.003"])
def test_the_checker_closes_what_it_builds(held: Held, name: str) -> None:
    task = parse_task(name)
    assert all(finding.passed is not False for finding in env_checker.check(task))
    assert env_checker.steps_per_second(task, 0.01) > 0
    assert held.built > 5
    assert held.names == {}


def test_a_gymnasium_task_that_is_refused_holds_nothing(held: Held) -> None:
    with pytest.raises(InputError, match="nothing is not an attribute"):
        parse_task("gym:MountainCar-v0:nothing=1")
    with pytest.raises(InputError, match="is not a number"):
        parse_task("gym:CartPole-v1:kinematics_integrator=1")
    assert held.built >= 2
    assert held.names == {}


class Still:
    """A source network that always takes the first action."""

    def rows(self, observations: Any) -> Any:
        return np.zeros((len(observations), 2), np.float32)


def test_who_plays_episodes_closes_the_environment(held: Held) -> None:
    self_delta(Still(), "cartpole", 0.99, 0, 2)
    with closing(DeepComparison("cartpole", [], 0.99, 0)) as comparison:
        comparison.play(None)
    assert held.built == 2
    assert held.names == {}
