"""The outcome of stage 1: for each source task the best hyperparameters, and the runs that used them."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

from orchestrator.planning.arms import Arm, Values
from trainables.cell import Cell


@dataclass(frozen=True)
class SourceRun:
    """One seed's run of stage 1 at the best hyperparameters."""

    cell: Cell
    best_return: float
    """Its best greedy evaluation."""
    auc: float
    steps: int
    """T, its number of training steps."""


Runs = Mapping[str, Mapping[int, SourceRun]]
"""Source task to seed to source run."""


@dataclass(frozen=True)
class SourceChoice:
    """The outcome of stage 1 for one source task."""

    values: Values
    """The best values of the hyperparameters that stage 1 swept."""
    runs: Mapping[int, SourceRun]
    """By seed."""
    lost: str = ""
    """Why there is none: no configuration has all its seeds. `values` and `runs` are then those of failed cells."""

    ranked: Mapping[str, int] = field(default_factory=dict)
    """Target task to the seed whose network has the smallest |delta| there; empty where nothing was ranked (yet)."""

    def seed_for(self, target: str) -> int:
        """Return the seed whose network is ranked first on a target; any seed as long as nothing is ranked."""
        return self.ranked.get(target, next(iter(self.runs)))

    def best_seed(self) -> int:
        """Return the seed with the best greedy evaluation; the best AUC breaks ties."""
        return max(self.runs, key=lambda seed: (self.runs[seed].best_return, self.runs[seed].auc))


Choices = Mapping[str, SourceChoice]
"""Source task to its outcome, for tasks on which stage 1 trains or selects anything."""


def settle(
    arms: Sequence[Mapping[str, Arm]], pretrained: Runs, outcome: Callable[[Arm], SourceChoice]
) -> list[Choices]:
    """Return the outcome of stage 1 for each scenario: a pretrained source, or the `outcome` of its training."""
    return [
        {
            task: pretrained_choice(arm, pretrained[task]) if task in pretrained else outcome(arm)
            for task, arm in scenario.items()
        }
        for scenario in arms
    ]


def pretrained_choice(arm: Arm, by_seed: Mapping[int, SourceRun]) -> SourceChoice:
    """Return the outcome of a stage 1 that need not run: its hyperparameters are those of the pretrained source."""
    cell = next(iter(by_seed.values())).cell
    return SourceChoice({name: value for name, value in cell.hyperparameters.items() if name in arm.swept}, by_seed)


PLACEHOLDER_STEPS = 10_000_000
"""T of a source that is not trained yet."""


def untrained(arm: Arm, steps: int = 0, lost: str = "") -> SourceChoice:
    """Return a placeholder for an unknown outcome: the first configuration, with runs that learned nothing."""
    values = arm.first()
    runs = {cell.seed: SourceRun(cell, -math.inf, -math.inf, steps) for cell in arm.cells(values)}
    return SourceChoice({name: value for name, value in values.items() if name in arm.swept}, runs, lost)
