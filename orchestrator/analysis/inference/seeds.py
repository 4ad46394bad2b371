"""What a statistic is computed from: the finished cells of a configuration, and those without transfer beside them."""

from __future__ import annotations

from dataclasses import dataclass, replace

import pandas as pd

from orchestrator.analysis.inference import crossed, pairs
from orchestrator.analysis.statistics import Estimate, TransferRatio


@dataclass(frozen=True)
class Seeds:
    """The finished cells of a configuration, and those of the agent without transfer at the same seeds."""

    done: pd.DataFrame
    paired: pd.DataFrame | None = None
    """Each column twice, with the suffix `_base` for the agent without transfer; None where there is none."""

    def mean(self, column: str) -> Estimate | None:
        """Return the mean of a column with its interval, or None where a cell lacks it.

        Where source networks are crossed with seeds, both are random.
        """
        if not self._has(column):
            return None
        return replace(crossed.mean(crossed.rectangle(self.done, column)), p=None, df=None)

    def components(self, column: str) -> crossed.Components | None:
        """Return the shares of variance of a column; None where source networks are not crossed with seeds."""
        known = self._has(column) and self.done["seed"].duplicated().any()
        return crossed.components(crossed.rectangle(self.done, column)) if known else None

    def values(self, column: str) -> list[float] | None:
        """Return a column, a number per cell, or None where a cell lacks it."""
        return [float(value) for value in self.done[column]] if self._has(column) else None

    def difference(self, column: str) -> Estimate | None:
        """Return the mean difference of a column from the agent without transfer, or None where there is none."""
        return None if self.paired is None else pairs.difference(self.paired, column)

    def ratio(self, column: str) -> TransferRatio | None:
        """Return the transfer ratio of a column, or None where there is nothing to compare."""
        if self.paired is None:
            return None
        both = (crossed.rectangle(self.paired, name) for name in (column, f"{column}_base"))
        return crossed.transfer_ratio(*both)

    def _has(self, column: str) -> bool:
        return bool(len(self.done)) and column in self.done and not self.done[column].isna().any()


def whole_seeds(cells: pd.DataFrame) -> pd.DataFrame:
    """Return the done cells of those seeds of a configuration whose every cell is done, with each source network."""
    unfinished = cells.loc[cells["status"] != "done", "seed"]
    return cells[(cells["status"] == "done") & ~cells["seed"].isin(unfinished)]


def networks(cells: pd.DataFrame) -> int:
    """Return how many source networks each seed of a configuration is crossed with."""
    return int(cells["seed"].value_counts().max()) if len(cells) else 0
