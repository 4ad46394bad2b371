"""What the beginning of an evaluation curve says: the AUC until the advice ends, and the episodes to a solution.

Over the whole run every agent's curve is dominated by what comes after the advice, which hides what the advice did.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any

import numpy as np
import pandas as pd

from trainables.errors import InputError
from trainables.tasks.registry import parse_task

FEWEST = 2
"""Evaluations that an early AUC needs."""

EARLY, WINDOW, SOLVED_AFTER, SOLVED = "early_auc", "early_episodes", "episodes_to_solve", "solved"
"""The columns that `add` writes: the AUC until the advice ends; the episode at which that is; the first evaluation that
reached the task's solution (the last one, where none did); whether one did (1 or 0)."""


def until(window: float) -> str:
    """Return the column with the AUC of every cell of a task until the episode `window`."""
    return f"auc_until_{window:g}"


def add(cells: pd.DataFrame, points: pd.DataFrame) -> pd.DataFrame:
    """Return the cells table with the columns EARLY, WINDOW, SOLVED_AFTER and SOLVED, and one of `until` per window.

    An agent with advice has its own window, advice_fraction of its episodes; one without has the shortest window of
    those with advice on its task. NaN where there is none, and for a cell that is not done.
    """
    if cells.empty or not {"cell_id", "episode", "greedy_return"} <= set(points):
        return cells
    done = cells.loc[cells["status"] == "done", "cell_id"]
    curves = points.loc[points["cell_id"].isin(done), ["cell_id", "episode", "greedy_return"]].dropna()
    if curves.empty:
        return cells
    own = cells["hyperparameters"].map(_window)
    usual = own.groupby(cells["task"]).transform("min")
    table = cells.assign(**{WINDOW: own.fillna(usual)})
    for window in sorted(own.dropna().unique()):
        on_task = table["task"].isin(table.loc[own == window, "task"])
        table[until(window)] = table["cell_id"].map(_auc_until(curves, window)).where(on_task)
    table[EARLY] = np.nan
    for window in sorted(table[WINDOW].dropna().unique()):
        table[EARLY] = table[EARLY].where(table[WINDOW] != window, table[until(window)])
    return _with_solutions(table, curves)


def window_of(hyperparameters: Mapping[str, Any]) -> float | None:
    """Return the episode at which an agent's advice ends, or None for an agent without advice."""
    fraction, episodes = hyperparameters.get("advice_fraction"), hyperparameters.get("episodes")
    both = all(isinstance(value, int | float) and not isinstance(value, bool) for value in (fraction, episodes))
    return float(fraction * episodes) if both and fraction and episodes else None


def aligned(pairs: pd.DataFrame) -> pd.DataFrame:
    """Return pairs of cells with EARLY until one and the same episode on both sides.

    That is the shorter of the windows of those with advice.
    """
    if WINDOW not in pairs:
        return pairs
    both = (window_of(json.loads(pairs[name].iloc[0])) for name in ("hyperparameters", "hyperparameters_base"))
    column = until(min([window for window in both if window is not None] or [pairs[WINDOW].iloc[0]]))
    if column not in pairs:
        return pairs
    return pairs.assign(**{EARLY: pairs[column], f"{EARLY}_base": pairs[f"{column}_base"]})


def _window(hyperparameters: str) -> float:
    window = window_of(json.loads(hyperparameters))
    return np.nan if window is None else window


def _auc_until(curves: pd.DataFrame, window: float) -> pd.Series:
    """Return the mean evaluation until an episode by cell id; NaN for fewer than FEWEST evaluations."""
    found = curves[curves["episode"] <= window].groupby("cell_id")["greedy_return"].agg(["mean", "count"])
    return pd.Series(found["mean"].where(found["count"] >= FEWEST))


def _with_solutions(table: pd.DataFrame, curves: pd.DataFrame) -> pd.DataFrame:
    level = table["task"].map({task: _solved_at(str(task)) for task in table["task"].unique()}).astype(np.float64)
    of_cell = table.assign(level=level).drop_duplicates("cell_id").set_index("cell_id")["level"]
    needed = curves["cell_id"].map(of_cell)
    first = curves[curves["greedy_return"] >= needed].groupby("cell_id")["episode"].min()
    last = curves[needed.notna()].groupby("cell_id")["episode"].max()
    after = last.astype(np.float64)
    after.update(first.astype(np.float64))
    return table.assign(
        **{
            SOLVED_AFTER: table["cell_id"].map(after),
            SOLVED: table["cell_id"].map(pd.Series(last.index.isin(first.index), last.index).astype(np.float64)),
        }
    )


def _solved_at(task: str) -> float:
    try:
        level = parse_task(task).family.solved_at
    except InputError:  # a custom task whose code is not here
        level = None
    return np.nan if level is None else level
