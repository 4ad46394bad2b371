"""deltatune: sweeps that measure whether knowledge from one task helps or hurts on another.

This module offers the whole public interface; each name is imported when it is first used:

    import deltatune

    results = deltatune.sweep("demo", seeds=2, hyperparameters={"episodes": 500}, name="try")
    results.best          # a data frame; so are .table, .cells, .points and .curves()
    deltatune.load("try")     # the same, later

    cell = deltatune.Cell.create("q_learning", "windy_gridworld:wind=reversed", seed=0)
    for point in deltatune.train(cell):
        print(point.episode, point.greedy_return)
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from deltatune.run import sweep
    from deltatune.sweep_results import SweepResults, load
    from orchestrator.errors import SweepError
    from search_spaces.loading import load as load_space
    from search_spaces.search_space import SearchSpace
    from trainables.agents.agent import Agent
    from trainables.agents.base import Count, Hyperparameters, NonNegative, Positive, Probability, Rate
    from trainables.agents.builtin.dqn import DQN
    from trainables.agents.builtin.explicit_shaping import ExplicitShaping
    from trainables.agents.builtin.gates import Threshold
    from trainables.agents.builtin.q_learning import QLearning, Transfer
    from trainables.cell import Cell, Source
    from trainables.curve import EvalPoint
    from trainables.custom import agent, feature, tabular_task, task
    from trainables.custom import load as load_custom
    from trainables.delta.bounds import bounds
    from trainables.errors import InputError
    from trainables.knowledge import Knowledge
    from trainables.learners.dqn import DeepLearner
    from trainables.learners.step_learner import StepLearner
    from trainables.tasks.make import make_env
    from trainables.tasks.registry import parse_task
    from trainables.tasks.spec.tabular_model import TransitionModel
    from trainables.training.ray_tune import trainable
    from trainables.training.train import train

_PLACES = {
    "deltatune.run": ("sweep",),
    "deltatune.sweep_results": ("SweepResults", "load"),
    "orchestrator.errors": ("SweepError",),
    "search_spaces.loading": ("load_space:load",),
    "search_spaces.search_space": ("SearchSpace",),
    "trainables.agents.agent": ("Agent",),
    "trainables.agents.hyperparameters": (
        *("Hyperparameters", "QLearning", "Transfer", "DQN", "ExplicitShaping"),
        *("Count", "NonNegative", "Positive", "Probability", "Rate", "Threshold"),
    ),
    "trainables.cell": ("Cell", "Source"),
    "trainables.curve": ("EvalPoint",),
    "trainables.delta.bounds": ("bounds",),
    "trainables.errors": ("InputError",),
    "trainables.knowledge": ("Knowledge",),
    "trainables.learners.dqn": ("DeepLearner",),
    "trainables.learners.step_learner": ("StepLearner",),
    "trainables.custom": ("agent", "feature", "tabular_task", "task", "load_custom:load"),
    "trainables.tasks.make": ("make_env",),
    "trainables.tasks.registry": ("parse_task",),
    "trainables.tasks.spec.tabular_model": ("TransitionModel",),
    "trainables.training.ray_tune": ("trainable",),
    "trainables.training.train": ("train",),
}
"""Module to the names that it provides; 'PUBLIC:ORIGINAL' where the two differ."""

_HOME = {
    name.partition(":")[0]: (module, name.partition(":")[2] or name)
    for module, names in _PLACES.items()
    for name in names
}

__all__ = [
    "DQN",
    "Agent",
    "Cell",
    "Count",
    "DeepLearner",
    "EvalPoint",
    "ExplicitShaping",
    "Hyperparameters",
    "InputError",
    "Knowledge",
    "NonNegative",
    "Positive",
    "Probability",
    "QLearning",
    "Rate",
    "SearchSpace",
    "Source",
    "StepLearner",
    "SweepError",
    "SweepResults",
    "Threshold",
    "Transfer",
    "TransitionModel",
    "agent",
    "bounds",
    "feature",
    "load",
    "load_custom",
    "load_space",
    "make_env",
    "parse_task",
    "sweep",
    "tabular_task",
    "task",
    "train",
    "trainable",
]


def __getattr__(name: str) -> Any:
    """Import and return a name of the public interface; `__version__` is the installed distribution's."""
    if name == "__version__":
        from orchestrator.results.provenance import versions

        return versions().get("deltatune", "unknown")
    if name not in _HOME:
        raise AttributeError(f"module 'deltatune' has no attribute '{name}'")
    if name == "sweep":
        from orchestrator.process_env import prepare

        prepare()  # before Ray or MLflow is imported
    module, there = _HOME[name]
    value = getattr(importlib.import_module(module), there)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    """Return the names of the interface, for completion."""
    return [*__all__, "__version__"]
