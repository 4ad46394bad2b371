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
    found = {column: _bands(pd.DataFrame(table[column])) for column in there}
    return {
        (group, column): found[column].get(group, NO_CURVE) if column in found else NO_CURVE
        for group in groups
        for column in columns
    }


def _bands(table: pd.DataFrame) -> dict[str, pd.DataFrame]:
    """Return (episode, mean, low, high) by group, for a table of (mean, std, count) by group and episode."""
    whole = table[table["count"] > 0].reset_index()
    t = stats.t.ppf((1 + statistics.LEVEL) / 2, np.maximum(whole["count"] - 1, 1))
    half = np.where(whole["count"] > 1, t * whole["std"].fillna(0.0) / np.sqrt(whole["count"]), 0.0)
    bands = whole[["group", "episode", "mean"]].assign(low=whole["mean"] - half, high=whole["mean"] + half)
    empty = dict.fromkeys(table.index.unique("group"), bands.iloc[:0])
    every = empty | {str(group): band for group, band in bands.groupby("group", sort=False)}
    return {group: band.drop(columns="group").reset_index(drop=True) for group, band in every.items()}
