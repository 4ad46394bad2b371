"""Cells of two configurations side by side, and the mean of their differences."""

from __future__ import annotations

import pandas as pd

from orchestrator.analysis import statistics
from orchestrator.analysis.inference import crossed
from orchestrator.analysis.statistics import Estimate


def paired(first: pd.DataFrame, second: pd.DataFrame) -> pd.DataFrame:
    """Return the cells of both, a row per pair; the columns of the second have the ending `_base`.

    Each with the columns `seed` and `source_cell`. Paired by seed; where both have several source networks for a seed,
    by the source network too; where one of them alone has, each of its cells with the other's of that seed.
    """
    both = all(frame["seed"].duplicated().any() for frame in (first, second))
    on = ["seed", "source_cell"] if both else ["seed"]
    found = first.merge(second, on=on, suffixes=("", "_base"))
    if "source_cell_base" in found and not first["seed"].duplicated().any() and found["seed"].duplicated().any():
        found["source_cell"] = found["source_cell_base"]
    return found.sort_values("seed", kind="stable")


def difference(pairs: pd.DataFrame, column: str) -> Estimate | None:
    """Return the mean of COLUMN - COLUMN_base over pairs, with an interval and p-value; None without pairs.

    By Student's t over seeds, or with source networks and seeds both random where they are crossed.
    """
    names = [column, f"{column}_base"]
    if not len(pairs) or not set(names) <= set(pairs) or pairs[names].isna().any(axis=None):
        return None
    gaps = statistics.differences(list(pairs[column]), list(pairs[names[1]]))
    return crossed.mean(crossed.rectangle(pairs.reindex(columns=crossed.BY).assign(gap=gaps), "gap"))
