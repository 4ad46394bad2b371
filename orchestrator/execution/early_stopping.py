"""Tune's schedulers, one for each arm: only configurations of the same arm compete."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from typing import Any

from ray.tune.schedulers import AsyncHyperBandScheduler, FIFOScheduler, MedianStoppingRule, TrialScheduler

from orchestrator.planning.arms import Arm
from search_spaces.search_space import Scheduler
from trainables.cell import Cell

TIME, METRIC = "evaluations", "score"
"""What `run_cells` reports of cells that run together."""

Scores = Sequence[float]
"""The scores of a configuration by evaluation, from the first on."""


def scheduler(settings: Scheduler, cell: Cell) -> TrialScheduler:
    """A new scheduler for the arm that `cell` is of."""
    if settings.method == "asha":
        evaluations = 1 + math.ceil(cell.settings.episodes / cell.settings.evaluate_every)
        return AsyncHyperBandScheduler(
            time_attr=TIME,
            metric=METRIC,
            mode="max",
            max_t=evaluations,
            grace_period=min(settings.grace, evaluations),
            reduction_factor=settings.reduction_factor,
            stop_last_trials=False,
        )
    return MedianStoppingRule(
        time_attr=TIME, metric=METRIC, mode="max", grace_period=settings.grace, min_time_slice=10**9
    )


class _Past:
    """Stands for a trial of an earlier run."""

    def __init__(self, number: int) -> None:
        self.trial_id = f"past{number}"


class ArmSchedulers(FIFOScheduler):
    """Hands each result to its arm's scheduler, which first sees what earlier runs of the sweep had of the arm.

    cells: the cells of a trial that may be stopped; empty for the others.
    arms: those of the stage.
    history: the scores of an arm's configurations in earlier runs.
    """

    def __init__(
        self,
        settings: Scheduler,
        cells: Callable[[str], Sequence[Cell]],
        arms: Sequence[Arm],
        history: Callable[[Arm], Iterable[Scores]],
    ) -> None:
        super().__init__()  # type: ignore[no-untyped-call]
        self._settings, self._cells, self._arms, self._history = settings, cells, arms, history
        self._schedulers: dict[str, TrialScheduler] = {}
        self._trials: dict[str, TrialScheduler] = {}
        self.stopped: dict[str, str] = {}
        """Trial to the reason."""

    def __getstate__(self) -> dict[str, Any]:
        """Nothing to save: a sweep resumes from its records, never from Tune's."""
        return {}

    def on_trial_result(self, tune_controller: Any, trial: Any, result: dict[str, Any]) -> str:
        """Whether a trial goes on."""
        if METRIC not in result or not (cells := self._cells(trial.trial_id)):
            return str(TrialScheduler.CONTINUE)
        if trial.trial_id not in self._trials:
            self._trials[trial.trial_id] = self._scheduler(tune_controller, cells)
            self._trials[trial.trial_id].on_trial_add(tune_controller, trial)
        decision = self._trials[trial.trial_id].on_trial_result(tune_controller, trial, result)
        if decision == TrialScheduler.STOP:
            self.stopped[trial.trial_id] = f"stopped early by {self._settings.method} after {result[TIME]} evaluations"
        return str(decision)

    def _scheduler(self, controller: Any, cells: Sequence[Cell]) -> TrialScheduler:
        arm = next(arm for arm in self._arms if all(arm.owns(cell) for cell in cells))
        if arm.content not in self._schedulers:
            self._schedulers[arm.content] = new = scheduler(self._settings, cells[0])
            for number, scores in enumerate(self._history(arm)):
                past: Any = _Past(number)
                new.on_trial_add(controller, past)
                for evaluation, score in enumerate(scores, start=1):
                    new.on_trial_result(controller, past, {TIME: evaluation, METRIC: score})
        return self._schedulers[arm.content]
