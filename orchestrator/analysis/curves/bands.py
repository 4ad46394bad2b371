"""Evaluation curves over seeds: mean and interval."""

from __future__ import annotations

from collections.abc import Collection

import numpy as np
import pandas as pd
from scipy import stats

from orchestrator.analysis import statistics

NO_CURVE = pd.DataFrame({"episode": [], "mean": [], "low": [], "high": []})
"""The mean curve of a group without a done cell."""


def mean_curves(points: pd.DataFrame, cells: pd.DataFrame) -> dict[str, pd.DataFrame]:
    """Return the mean curve of the greedy return for every group with a done cell, by group id."""
    names = cells.loc[cells["status"] == "done", "group"].unique()
    curves = curve_bands(points, cells, [str(name) for name in names], ["greedy_return"])
    return {group: curve for (group, _), curve in curves.items()}


def curve_bands(
    points: pd.DataFrame, cells: pd.DataFrame, groups: Collection[str], columns: Collection[str]
) -> dict[tuple[str, str], pd.DataFrame]:
    """Return (episode, mean, low, high) over the done seeds of each (group, column), with Student's t intervals.

    A seed's curve is the mean over its source networks.

    One pass over the points computes all. The table is empty where a group's points lack the column.
    """
    there = [column for column in columns if column in points]
    if not groups or not there:
        return {(group, column): NO_CURVE for group in groups for column in columns}
    chosen = cells.loc[cells["group"].isin(groups) & (cells["status"] == "done"), ["cell_id", "group", "seed"]]
    joined = points[["cell_id", "episode", *there]].merge(chosen, on="cell_id")
    if chosen.duplicated(["group", "seed"]).any():  # source networks: their mean is a seed's curve
        joined = joined.groupby(["group", "seed", "episode"], as_index=False)[there].mean()
    table = joined.groupby(["group", "episode"])[there].agg(["mean", "std", "count"])
    known = set(chosen["group"])
    return {
        (group, column): _band(pd.DataFrame(table.loc[group][column]))
        if group in known and column in there
        else NO_CURVE
        for group in groups
        for column in columns
    }


def _band(table: pd.DataFrame) -> pd.DataFrame:
    """Return (episode, mean, low, high) for a table of (mean, std, count) by episode."""
    table = table[table["count"] > 0].reset_index()
    t = stats.t.ppf((1 + statistics.LEVEL) / 2, np.maximum(table["count"] - 1, 1))
    half = np.where(table["count"] > 1, t * table["std"].fillna(0.0) / np.sqrt(table["count"]), 0.0)
    return table[["episode", "mean"]].assign(low=table["mean"] - half, high=table["mean"] + half)
