"""Whether anything was learned, and the sentence on it for tables, the report and the registry."""

from __future__ import annotations

from collections.abc import Sequence

import pandas as pd

from orchestrator.analysis.statistics import TIE


def learned_nothing(returns: Sequence[float]) -> str | None:
    """Return the sentence for an evaluation curve that never left its first value, or None."""
    if len(returns) < 2 or not all(_same(value, returns[0]) for value in returns):
        return None
    return f"learned nothing: its greedy return never left {returns[0]:g}"


def nothing_in(cells: pd.DataFrame) -> str | None:
    """Return the same for all seeds of an agent without transfer, from their rows of the cells table."""
    names = ["initial_return", "best_return", "final_return", "auc"]
    if not len(cells) or not set(names) <= set(cells):
        return None
    found = [learned_nothing([float(row[name]) for name in names]) for row in cells[names].to_dict("records")]
    return found[0] if all(found) else None


def _same(value: float, first: float) -> bool:
    return abs(value - first) <= TIE * max(abs(value), abs(first))
