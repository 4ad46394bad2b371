"""Whether anything was learned, and in which words that is said: in the tables, the report and the registry alike."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import pandas as pd

from orchestrator.analysis.statistics import TIE

FEW_EVALUATIONS = 5
"""Evaluations of a curve below which its mean says little."""


def learned_nothing(returns: Sequence[float]) -> str | None:
    """Return the sentence for an evaluation curve that never left its first value, or None."""
    if len(returns) < 2 or not all(_same(value, returns[0]) for value in returns):
        return None
    return f"learned nothing: its greedy return never left {returns[0]:g}"


def nothing_in(cells: pd.DataFrame) -> str | None:
    """Return the same for all seeds of an agent without transfer, by their rows of the cells table."""
    names = ["initial_return", "best_return", "final_return", "auc"]
    if not len(cells) or not set(names) <= set(cells):
        return None
    found = [learned_nothing([float(row[name]) for name in names]) for row in cells[names].to_dict("records")]
    return found[0] if all(found) else None


def few_evaluations(hyperparameters: Mapping[str, Any]) -> str | None:
    """Return a warning where a training has so few evaluations that its AUC says little, or None."""
    episodes, every = hyperparameters.get("episodes"), hyperparameters.get("evaluate_every")
    if not isinstance(episodes, int) or not isinstance(every, int) or every < 1:
        return None
    count = 1 + math.ceil(episodes / every)
    if count >= FEW_EVALUATIONS:
        return None
    wanted = max(episodes // (FEW_EVALUATIONS - 1), 1)
    return (
        f"episodes={episodes} with evaluate_every={every} leaves {count} evaluations, one of them before training, "
        f"of which the AUC is the mean: --set evaluate_every={wanted}"
    )


def _same(value: float, first: float) -> bool:
    return abs(value - first) <= TIE * max(abs(value), abs(first))
