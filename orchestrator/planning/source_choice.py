"""The outcome of stage 1: whose knowledge each seed of a scenario gets."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from orchestrator.planning.arms import Pair, Values
from trainables.cell import Cell


@dataclass(frozen=True)
class SourceRun:
    """One seed's run of stage 1 at the best hyperparameters."""

    cell: Cell
    best_return: float
    """Its best greedy evaluation."""
    auc: float
    steps: int
    """T: the training steps that it took."""


@dataclass(frozen=True)
class SourceChoice:
    """The outcome of stage 1 for one scenario."""

    values: Values
    """The best hyperparameters of the source's agent, those that stage 1 swept."""
    runs: Mapping[int, SourceRun]
    """By seed."""
    library: tuple[SourceChoice, ...] = ()
    """The same for each further task of the scenario's library."""

    def best_seed(self) -> int:
        """The seed with the best greedy evaluation; of those that reach the same, the one with the best AUC."""
        return max(self.runs, key=lambda seed: (self.runs[seed].best_return, self.runs[seed].auc))


Runs = Mapping[str, Mapping[int, SourceRun]]
"""Source task to seed to source run."""


def choice(pair: Pair, by_seed: Mapping[int, SourceRun]) -> SourceChoice:
    """The outcome of a stage 1 that need not run: what it would have swept has the given source's values."""
    cell = next(iter(by_seed.values())).cell
    return SourceChoice({name: value for name, value in cell.hyperparameters.items() if name in pair.swept}, by_seed)
