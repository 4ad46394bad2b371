"""Sweeps that were never run: tables of any size for the report."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from orchestrator.analysis.findings import Findings, find
from orchestrator.results.sweep_folder import Results
from search_spaces.loading import parse
from trainables.cell import Cell, Source
from trainables.tasks.registry import parse_task

GRIDS: dict[str, list[dict[str, Any]]] = {
    "q_learning": [{}],
    "policy_reuse": [{}],
    "ppr": [{"nu": nu} for nu in (0.99, 0.9, 0.8)],
    "delta_gate": [{"threshold": value, "delta_learning_rate": rate} for value in (10.0, 3.0) for rate in (0.05, 0.5)],
    "confidence_gate": [{}],
}
"""Ten configurations."""


def findings(
    storage: Path,
    targets: int,
    seeds: int,
    evaluations: int,
    grids: Mapping[str, Sequence[dict[str, Any]]] = GRIDS,
    **more: Any,
) -> Findings:
    """The findings of targets x seeds cells of each configuration, with curves of so many evaluations.

    `more` goes into the space.
    """
    tasks = [parse_task(f"windy_gridworld:start=[{row},0],wind=small").name for row in range(targets)]
    space = {
        "schema": 1,
        "name": "synthetic",
        "seeds": seeds,
        "scenarios": [{"source": {"task": "windy_gridworld", "kinds": ["exact"]}, "targets": tasks}],
        "agents": {agent: {} for agent in grids},
        **more,
    }
    results = Results.create(storage, "synthetic", parse("synthetic", space))
    cells = [
        Cell.create(agent, task, seed, values, None if agent == "q_learning" else source)
        for source in [Source(task="windy_gridworld", kind="exact")]
        for task in tasks
        for agent, grid in grids.items()
        for values in grid
        for seed in range(seeds)
    ]
    return find(results, tables(cells, evaluations))


def tables(cells: Sequence[Cell], evaluations: int) -> tuple[pd.DataFrame, pd.DataFrame]:
    """(cells, points) as a sweep writes them, with random curves."""
    rng = np.random.default_rng(0)
    episodes = np.arange(evaluations) * 10
    rows, curves = [], []
    for number, cell in enumerate(cells):
        returns = -200 + (100 + 37 * number % 90) * (1 - np.exp(-episodes / 800)) + rng.normal(0, 4, evaluations)
        points: dict[str, Any] = {"cell_id": cell.id, "episode": episodes, "greedy_return": returns}
        points |= {"threshold": np.full(evaluations, 4.5)} if cell.hyperparameters.get("threshold") == "auto" else {}
        points |= {"max_abs_delta": rng.normal(8, 1, evaluations), "gate_open_share": rng.random(evaluations)}
        curves.append(pd.DataFrame(points))
        rows.append(row(cell, returns))
    return pd.DataFrame(rows), pd.concat(curves, ignore_index=True)


def row(cell: Cell, returns: np.ndarray) -> dict[str, Any]:
    """A finished cell's row."""
    auc = float(returns.mean())
    return {
        "cell_id": cell.id,
        "stage": "transfer",
        "status": "done",
        "agent": cell.agent,
        "task": cell.task,
        "source_task": cell.sources[0].task if cell.sources else None,
        "source": cell.sources[0].kind if cell.sources else "none",
        "seed": cell.seed,
        "group": cell.group,
        "auc": auc,
        "training_auc": auc,
        "initial_return": float(returns[0]),
        "asymptotic": float(returns[-1]),
        "final_max_abs_delta": 3.0 + auc / 100,
        "error": None,
        "seconds": 1.0,
        "hyperparameters": json.dumps(cell.hyperparameters, sort_keys=True),
    }
