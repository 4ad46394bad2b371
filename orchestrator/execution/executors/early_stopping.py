"""Early stopping of configurations: asynchronous successive halving and the median rule, within each arm."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from typing import Protocol

import numpy as np

from orchestrator.planning.arms import Arm
from search_spaces.search_space import Scheduler
from trainables.cell import Cell

MIN_RIVALS = 3
"""Configurations that the median rule needs for a comparison."""

Scores = Sequence[float]
"""The scores of a configuration by evaluation, from the first on."""


class Rule(Protocol):
    """Judges the configurations of one arm."""

    def stops(self, trial: str, evaluation: int, score: float) -> bool:
        """Record a score (higher is better), and return whether to stop the trial."""


class SuccessiveHalving:
    """ASHA (Li et al. 2020), stopping variant: at each rung only the best 1/`factor` of those seen so far continue.

    Its decisions equal those of Ray Tune's AsyncHyperBandScheduler with one bracket and `stop_last_trials=False`.
    """

    def __init__(self, grace: int, evaluations: int, factor: float) -> None:
        grace = min(grace, evaluations)
        rungs = int(np.log(evaluations / grace) / np.log(factor) + 1)
        self._quantile = (1 - 1 / factor) * 100
        self._rungs: list[tuple[float, dict[str, float]]] = [(grace * factor**k, {}) for k in reversed(range(rungs))]

    def stops(self, trial: str, evaluation: int, score: float) -> bool:
        """Decide once at each rung, the highest that the trial has reached."""
        for milestone, scores in self._rungs:
            if evaluation < milestone:
                continue
            if trial in scores:
                return False
            worse = bool(scores) and score < np.nanpercentile(list(scores.values()), self._quantile)
            scores[trial] = score
            return bool(worse)
        return False


class MedianStopping:
    """The median rule (Golovin et al. 2017): stop a trial whose best score is below the median of the others' means."""

    def __init__(self, grace: int) -> None:
        self._grace = grace
        self._scores: dict[str, dict[int, float]] = {}

    def stops(self, trial: str, evaluation: int, score: float) -> bool:
        """Compare with the trials that have reached the same evaluation."""
        own = self._scores.setdefault(trial, {})
        own[evaluation] = score
        if evaluation < self._grace:
            return False
        rivals = [scores for name, scores in self._scores.items() if name != trial and max(scores) >= evaluation]
        means = [self._mean(scores, evaluation) for scores in rivals]
        means = [mean for mean in means if math.isfinite(mean)]
        return len(means) >= MIN_RIVALS and bool(np.median(means) > max(own.values()))

    def _mean(self, scores: dict[int, float], evaluation: int) -> float:
        seen = [score for at, score in scores.items() if self._grace <= at <= evaluation]
        return float(np.mean(seen)) if seen else math.nan


def rule(settings: Scheduler, cell: Cell) -> Rule:
    """Return a new rule for the arm of `cell`."""
    if settings.method == "asha":
        evaluations = 1 + math.ceil(cell.episodes / cell.settings.evaluate_every)
        return SuccessiveHalving(settings.grace, evaluations, settings.reduction_factor)
    return MedianStopping(settings.grace)


class EarlyStopping:
    """Passes each score to its arm's rule, which first gets the arm's scores in earlier runs of the sweep.

    arms: those of the stage. history: returns the scores of an arm's configurations in earlier runs.
    """

    def __init__(self, settings: Scheduler, arms: Sequence[Arm], history: Callable[[Arm], Iterable[Scores]]) -> None:
        self._settings, self._arms, self._history = settings, arms, history
        self._rules: dict[str, Rule] = {}
        self._trials: dict[str, Rule] = {}
        self.stopped: dict[str, str] = {}
        """Trial to the reason."""

    def stops(self, trial: str, cells: Sequence[Cell], evaluations: int, score: float) -> bool:
        """Return whether to stop the trial of `cells` now."""
        if trial not in self._trials:
            self._trials[trial] = self._rule(cells)
        if not self._trials[trial].stops(trial, evaluations, score):
            return False
        self.stopped[trial] = f"stopped early by {self._settings.method} after {evaluations} evaluations"
        return True

    def _rule(self, cells: Sequence[Cell]) -> Rule:
        """Return the rule of the cells' arm."""
        arm = next(arm for arm in self._arms if all(arm.owns(cell) for cell in cells))
        if arm.content not in self._rules:
            self._rules[arm.content] = new = rule(self._settings, cells[0])
            for number, scores in enumerate(self._history(arm)):
                for evaluation, score in enumerate(scores, start=1):
                    new.stops(f"past{number}", evaluation, score)
        return self._rules[arm.content]
