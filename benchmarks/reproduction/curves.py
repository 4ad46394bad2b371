"""The published cells by arm: AUCs by source network and seed, and parts of their curves."""

from __future__ import annotations

import json
from collections.abc import Collection, Mapping
from dataclasses import dataclass
from functools import cache
from typing import Any

import pandas as pd

from benchmarks.reproduction.claims import Arm
from orchestrator.analysis.inference import crossed, pairs
from orchestrator.analysis.statistics import Estimate, TransferRatio
from orchestrator.analysis.tables.paper_table1 import SHARE
from orchestrator.dataset.dataset import Dataset
from trainables.agents.registry import agent_named
from trainables.tasks.registry import parse_task

EARLY = {"first_tenth": 0.1, "early": 0.3}
"""Column to the share of the training that it is the AUC of; nearly all of a deep agent's advice acts in the latter."""

BASELINES = ("baselines-cartpole", "baselines-acrobot", "baselines-lunar-lander")
EXPLORATION, FRACTIONS, SAFE = "exploration-cartpole", "figure4-cartpole", "safe-tasks"
"""Names of sweeps for parts of the page of their own."""

STUDIES = (*BASELINES, EXPLORATION, FRACTIONS, SAFE, "collapse", "delta-factor", "source-networks")
"""Beginnings of the names of sweeps that are no experiment of the paper."""

POINTS = ("cell_id", "episode", "greedy_return")

TUNED = frozenset({"learning_rate", "delta_learning_rate", "threshold", "nu", "last_layer", "floor"})
"""Hyperparameters of which the best is taken; all others are the paper's, unless an arm names them."""

PAPERS = {"advice_fraction": SHARE, "begins": "source"}
"""The paper's values of those that have another default, or none; and what an agent is without its ablation."""


class Curves:
    """Published cells of learned sources at the paper's scale, with the statistics that claims are about."""

    def __init__(self, dataset: Dataset, sweeps: Collection[str]) -> None:
        here = dataset.cells["sweep"].isin(sweeps) & (dataset.cells["source"] != "exact")
        cells = dataset.cells[here].drop_duplicates("cell_id").copy()
        cells["settings"] = [json.loads(cell)["hyperparameters"] for cell in cells["cell"]]
        points = dataset.points(list(cells["cell_id"])) if len(cells) else pd.DataFrame(columns=POINTS)
        ends = points.groupby("cell_id")["episode"].transform("max")
        for column, share in EARLY.items():
            early = points[points["episode"] <= share * ends].groupby("cell_id")["greedy_return"].mean()
            cells[column] = cells["cell_id"].map(early)
        cells["after_start"] = cells["cell_id"].map(
            points[points["episode"] > 0].groupby("cell_id")["greedy_return"].mean()
        )
        advised = points.groupby("cell_id")["advised_factor"].mean() if "advised_factor" in points else {}
        cells["factor"] = cells["cell_id"].map(advised)
        self._cells, self._points = cells, points
        self._best: dict[tuple[str, Arm], pd.DataFrame] = {}

    def points(self, target: str, arm: Arm) -> pd.DataFrame:
        """Return the curves of the best configuration of an arm."""
        return self._points[self._points["cell_id"].isin(self.best(target, arm)["cell_id"])]

    def configurations(self, target: str, arm: Arm) -> dict[str, pd.DataFrame]:
        """Return the cells of every configuration of an arm on a target, by group: one per source network and seed."""
        cells, task = self._cells, parse_task(target).name
        here = cells[(cells["task"] == task) & (cells["agent"] == arm.agent)]
        fits = here[here["settings"].map(lambda settings: _fits(arm, task, settings)).astype(bool)]
        return {
            str(group): rows.drop_duplicates(["seed", "source_cell"]).sort_values("seed", kind="stable")
            for group, rows in fits.groupby("group")
        }

    def best(self, target: str, arm: Arm) -> pd.DataFrame:
        """Return the cells of the configuration with the best mean AUC, by seed; empty where there is none."""
        if (target, arm) not in self._best:
            found = self.configurations(target, arm).values()
            best = max(found, key=lambda rows: float(rows["auc"].mean()), default=self._cells.iloc[:0])
            self._best[target, arm] = best
        return self._best[target, arm]

    def mean(self, target: str, arm: Arm, column: str = "auc") -> Estimate | None:
        """Return the mean of `column` with an interval over source networks and seeds; None where nothing was run."""
        cells = self.best(target, arm)
        return None if cells.empty else crossed.mean(crossed.rectangle(cells, column))

    def paired(self, target: str, first: Arm, second: Arm) -> pd.DataFrame:
        """Return the cells of both arms side by side, where both have the seed; those of the second end in `_base`."""
        return pairs.paired(self.best(target, first), self.best(target, second))


@dataclass(frozen=True)
class Published:
    """The published cells by the part of the page that they are for: no agent's best is chosen among several parts."""

    paper: Curves
    """The paper's experiments."""
    baselines: Curves
    """Other uses of a source."""
    safe: Curves
    """The safe agent and its rivals on all tasks, with as many seeds for each of them."""
    fractions: Curves
    """Figure 4: several shares of the training with advice."""


def published(dataset: Dataset) -> Published:
    """Return the parts of a dataset."""
    names = set(dataset.cells["sweep"])
    return Published(
        Curves(dataset, {name for name in names if not name.startswith(STUDIES)}),
        Curves(dataset, {*BASELINES, EXPLORATION}),
        Curves(dataset, {*BASELINES, SAFE}),
        Curves(dataset, {FRACTIONS}),
    )


def seeds(cells: pd.DataFrame) -> int:
    """Return how many seeds cells have."""
    return int(cells["seed"].nunique())


def difference(both: pd.DataFrame, column: str = "auc", lead: float = 0.0) -> Estimate | None:
    """Return the mean difference of pairs with its interval and p-value; None for fewer than two seeds.

    lead: added to the first of each pair.
    """
    return None if seeds(both) < 2 else pairs.difference(both.assign(**{column: both[column] + lead}), column)


def transfer_ratio(both: pd.DataFrame) -> TransferRatio | None:
    """Return the transfer ratio of pairs in AUC; None for fewer than two seeds."""
    if seeds(both) < 2:
        return None
    return crossed.transfer_ratio(*(crossed.rectangle(both, column) for column in ("auc", "auc_base")))


@cache
def _defaults(agent: str, task: str) -> Mapping[str, Any]:
    return agent_named(agent).resolve(parse_task(task), {}).model_dump() | PAPERS


def _fits(arm: Arm, task: str, settings: Mapping[str, Any]) -> bool:
    """Return whether hyperparameters are those that an arm names, and else the paper's or tuned."""
    named, defaults = dict(arm.settings), _defaults(arm.agent, task)
    wanted = {name: named.get(name, defaults.get(name, value)) for name, value in settings.items()}
    free = TUNED - named.keys()
    return named.keys() <= settings.keys() and all(
        name in free or settings[name] == value for name, value in wanted.items()
    )
