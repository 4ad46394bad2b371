"""The published cells by arm: AUCs by seed, and parts of their curves."""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping
from typing import Any

import pandas as pd

from benchmarks.reproduction.claims import Arm
from orchestrator.dataset.dataset import Dataset
from trainables.tasks.registry import parse_task

EARLY = {"first_tenth": 0.1, "early": 0.3}
"""Column to the share of the training that it is the AUC of; nearly all of a deep agent's advice acts in the latter."""


class Curves:
    """Every published cell of learned sources, with the statistics that claims are about."""

    def __init__(self, dataset: Dataset) -> None:
        cells = dataset.cells[dataset.cells["source"] != "exact"].drop_duplicates("cell_id").copy()
        cells["settings"] = [json.loads(cell)["hyperparameters"] for cell in cells["cell"]]
        points = dataset.points(list(cells["cell_id"]))
        ends = points.groupby("cell_id")["episode"].transform("max")
        for column, share in EARLY.items():
            early = points[points["episode"] <= share * ends].groupby("cell_id")["greedy_return"].mean()
            cells[column] = cells["cell_id"].map(early)
        advised = points.groupby("cell_id")["advised_factor"].mean() if "advised_factor" in points else {}
        cells["factor"] = cells["cell_id"].map(advised)
        self._cells, self._points = cells, points
        self._best: dict[tuple[str, Arm], pd.DataFrame] = {}

    def points(self, target: str, arm: Arm) -> pd.DataFrame:
        """Return the curves of the best configuration of an arm."""
        return self._points[self._points["cell_id"].isin(self.best(target, arm)["cell_id"])]

    def configurations(self, target: str, arm: Arm) -> dict[str, pd.DataFrame]:
        """Return the cells of every configuration of an arm on a target, by group, each seed once."""
        cells = self._cells
        here = cells[(cells["task"] == parse_task(target).name) & (cells["agent"] == arm.agent)]
        fits = here[here["settings"].map(lambda settings: _fits(settings, arm.settings)).astype(bool)]
        return {str(group): rows.drop_duplicates("seed") for group, rows in fits.groupby("group")}

    def best(self, target: str, arm: Arm) -> pd.DataFrame:
        """Return the cells of the configuration with the best mean AUC, indexed by seed; empty where there is none."""
        if (target, arm) not in self._best:
            found = self.configurations(target, arm).values()
            best = max(found, key=lambda rows: float(rows["auc"].mean()), default=self._cells.iloc[:0])
            self._best[target, arm] = best.set_index("seed").sort_index()
        return self._best[target, arm]

    def paired(self, target: str, first: Arm, second: Arm, column: str = "auc") -> tuple[list[float], list[float]]:
        """Return `column` of both arms at the seeds that both have."""
        one, other = self.best(target, first), self.best(target, second)
        seeds = one.index.intersection(other.index)
        return list(one.loc[seeds, column]), list(other.loc[seeds, column])


def _fits(settings: Mapping[str, Any], wanted: Iterable[tuple[str, Any]]) -> bool:
    return all(settings.get(name) == value for name, value in wanted)
