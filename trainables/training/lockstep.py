"""Trains the seeds of one configuration side by side, so that a scheduler can stop them together by their mean."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

from trainables import curve
from trainables.training.cell_run import CellRun


@dataclass(frozen=True)
class Rung:
    """All runs have reached this many evaluations."""

    evaluations: int
    score: float
    """Mean over the runs of the mean greedy return so far, which at the end is the AUC."""


def lockstep(runs: Sequence[CellRun], stop: Callable[[], bool] = lambda: False) -> Iterator[Rung]:
    """Step the run that is farthest behind, and yield a Rung whenever all have reached another evaluation.

    A run that fails does not affect the others. Runs resumed from checkpoints of different ages catch up first.
    stop: called after each step; if it returns True, all runs are checkpointed.
    """
    reached = min(run.evaluations for run in runs)
    while live := [run for run in runs if not run.ended]:
        min(live, key=lambda run: run.evaluations).step()
        if stop():
            for run in live:
                run.save()
            return
        whole = [run for run in runs if not run.error]
        if whole and min(run.evaluations for run in whole) > reached:
            reached += 1
            yield Rung(reached, curve.auc([curve.auc(run.returns()[:reached]) for run in whole]))
