"""Every tabular agent on both tasks for a few episodes, as digests; by `python oracle_cells.py MODEL` without numba.

The supply chain's exact model takes plain Python minutes to build and to walk through, so it is handed over in the
file MODEL (its rows are tested one by one in test_supply_chain.py), and its evaluation looks a few steps ahead only.
All else runs as it is, and as plain Python where NUMBA_DISABLE_JIT=1.
"""

from __future__ import annotations

import dataclasses
import json
import sys
from collections.abc import Callable
from pathlib import Path
from unittest import mock

import numpy as np
from scipy.sparse import csr_array

from tests.trainables.small_cells import AGENTS, digest_of, small_cell
from trainables.cell import Cell
from trainables.knowledge import Knowledge
from trainables.learners import q_learning
from trainables.tasks.registry import model_of, parse_task
from trainables.tasks.spec.tabular_model import TransitionModel
from trainables.training.train import train

CHAIN = "supply_chain:demand_mean=5"
GRIDWORLD = "windy_gridworld:wind=additional_1"
SETTINGS = {
    GRIDWORLD: {"episodes": 25, "evaluate_every": 10, "epsilon_start": 0.3},
    CHAIN: {"episodes": 8, "evaluate_every": 3, "epsilon_start": 0.3},
}
LOOK_AHEAD = 10
"""Steps of the supply chain's evaluation."""
OWN = {
    "ppr": {"nu": 0.8},
    "delta_gate": {"threshold": 3.0, "delta_learning_rate": 0.4},
    "confidence_gate": {"threshold": 2.0, "z": 1.0, "min_visits": 2},
}
"""Settings under which the gates open and close within a few episodes."""


def cell(agent: str, task: str) -> Cell:
    """A cell of the comparison."""
    return small_cell(agent, task, seed=3, **SETTINGS[task], **OWN.get(agent, {}))


def source(task: str) -> Knowledge:
    """A source that is wrong in an interesting way: random numbers."""
    dynamics = parse_task(task).dynamics()
    q = np.random.default_rng(5).normal(0.0, 2.0, (dynamics.states, dynamics.actions))
    return Knowledge({"q": q})


def outcomes(chain: TransitionModel) -> dict[str, tuple[str, str, float]]:
    """agent/task to the digests of its curve and of what it has learned, and how often its gate moved."""
    short = dataclasses.replace(chain, time_limit=LOOK_AHEAD)
    models: Callable[[str], TransitionModel] = lambda task: short if task == CHAIN else model_of(task)  # noqa: E731
    with mock.patch.object(q_learning, "model_of", models):
        return {f"{agent}/{task}": _outcome(agent, task) for task in SETTINGS for agent in AGENTS}


def _outcome(agent: str, task: str) -> tuple[str, str, float]:
    training = train(cell(agent, task), None if agent == "q_learning" else source(task))
    points = list(training)
    return digest_of(points), training.knowledge().digest, points[-1].statistics.get("gate_flips", 0.0)


def save_model(path: Path) -> None:
    """Write the supply chain's exact model for the plain process."""
    model = model_of(CHAIN)
    p = model.transitions
    np.savez(path, data=p.data, indices=p.indices, indptr=p.indptr, rewards=model.rewards)


def load_model(path: Path) -> TransitionModel:
    """Read it."""
    with np.load(path) as file:
        rewards = file["rewards"]
        transitions = csr_array((file["data"], file["indices"], file["indptr"]), shape=(rewards.size, len(rewards)))
    dynamics = parse_task(CHAIN).dynamics()
    return TransitionModel(transitions, rewards, dynamics.start, dynamics.time_limit)


if __name__ == "__main__":
    assert not hasattr(q_learning.run_episodes, "py_func"), "compiled: set NUMBA_DISABLE_JIT=1"
    print(json.dumps(outcomes(load_model(Path(sys.argv[1])))))
