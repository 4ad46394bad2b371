"""The outcome of stage 1: for each source task the hyperparameters that were best, and the runs that have them."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

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
    """T: the training steps that it took."""


Runs = Mapping[str, Mapping[int, SourceRun]]
"""Source task to seed to source run."""


@dataclass(frozen=True)
class SourceChoice:
    """The outcome of stage 1 for one source task."""

    values: Values
    """The best hyperparameters of the source's agent, those that stage 1 swept."""
    runs: Mapping[int, SourceRun]
    """By seed."""
    lost: str = ""
    """Why there is none: no configuration has all its seeds. `values` and `runs` then stand for those that failed."""

    def best_seed(self) -> int:
        """Return the seed with the best greedy evaluation; of those that reach the same, the one with the best AUC."""
        return max(self.runs, key=lambda seed: (self.runs[seed].best_return, self.runs[seed].auc))


Choices = Mapping[str, SourceChoice]
"""Source task to its outcome; a task that nothing is learned or chosen on is not there."""


def settle(
    arms: Sequence[Mapping[str, Arm]], pretrained: Runs, outcome: Callable[[Arm], SourceChoice]
) -> list[Choices]:
    """Return the outcome of stage 1 for each scenario: of a pretrained source, or `outcome` of what was trained."""
    return [
        {
            task: pretrained_choice(arm, pretrained[task]) if task in pretrained else outcome(arm)
            for task, arm in scenario.items()
        }
        for scenario in arms
    ]


def pretrained_choice(arm: Arm, by_seed: Mapping[int, SourceRun]) -> SourceChoice:
    """Return the outcome of a stage 1 that need not run: what it would sweep has the pretrained source's values."""
    cell = next(iter(by_seed.values())).cell
    return SourceChoice({name: value for name, value in cell.hyperparameters.items() if name in arm.swept}, by_seed)


STAND_IN_STEPS = 10_000_000
"""T of a source that is not trained yet."""


def untrained(arm: Arm, steps: int = 0, lost: str = "") -> SourceChoice:
    """Return a stand-in for an outcome that is not there: the first configuration, as if nothing had been learned."""
    values = arm.first()
    runs = {cell.seed: SourceRun(cell, -math.inf, -math.inf, steps) for cell in arm.cells(values)}
    return SourceChoice({name: value for name, value in values.items() if name in arm.swept}, runs, lost)
