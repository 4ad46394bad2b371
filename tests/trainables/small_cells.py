"""Cells that train in milliseconds, and the few lines that every test of an agent needs."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from trainables import curve
from trainables.agents.registry import agent_named
from trainables.cell import Cell, Source
from trainables.curve import EvalPoint
from trainables.evaluation import expected_return
from trainables.knowledge import Knowledge
from trainables.tasks.registry import model_of, parse_task
from trainables.training.train import train

AGENTS = ("q_learning", "policy_reuse", "ppr", "delta_gate", "confidence_gate", "q_warm_start")
GATED = ("delta_gate", "confidence_gate")
REVERSED = "windy_gridworld:wind=reversed"
GAMMA = 0.99


def small_cell(agent: str, task: str = REVERSED, seed: int = 0, **values: Any) -> Cell:
    """A cell of a few episodes, with the exact source of its family for an agent that needs one."""
    source = Source(task=parse_task(task).family.name, kind="exact") if agent_named(agent).needs_source else None
    return Cell.create(agent, task, seed, {"episodes": 30, "evaluate_every": 10} | values, source)


def points_of(cell: Cell, source: Knowledge | None = None) -> list[EvalPoint]:
    """The whole evaluation curve."""
    return list(train(cell, source))


def digest_of(points: Sequence[EvalPoint]) -> str:
    """The digest of a curve."""
    return curve.digest(curve.columns(points))


def return_of(task: str, q: NDArray[np.float64]) -> float:
    """The exact undiscounted return on `task` of the greedy policy of `q` (S, A)."""
    return expected_return(model_of(task), q.argmax(axis=1), GAMMA)[0]
