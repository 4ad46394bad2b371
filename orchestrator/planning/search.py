"""Searching ranges of hyperparameters: random draws, and Optuna."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Iterable, Sequence
from typing import Any

import numpy as np
import optuna
from optuna.distributions import BaseDistribution, CategoricalDistribution, FloatDistribution, IntDistribution

from orchestrator.planning.arms import Arm, Values
from search_spaces.domains import Range
from search_spaces.search_space import Search
from trainables.cell import Cell

optuna.logging.set_verbosity(optuna.logging.WARNING)

Score = Callable[[Sequence[Cell]], float | None]
"""Returns the mean AUC of the cells of one configuration; None where one of them is not done."""


def draw(arm: Arm, search: Search) -> list[Values]:
    """Return `budget` random draws from the arm's ranges, the same each time; its grid values are cycled through."""
    rng = np.random.RandomState(_seeds(arm, search, 0))
    draws = []
    for number in range(search.budget):
        values = {name: _plain(sample(option, rng)) for name, option in arm.ranges.items()}
        draws.append(arm.grid[number % len(arm.grid)] | values)
    return draws


def sample(option: Range, rng: np.random.RandomState) -> float | int:
    """Return one draw from a range: uniform, or uniform in the logarithm."""
    low, high = option.low, option.high + option.integer
    if option.log:
        value = np.exp(rng.uniform(np.log(low), np.log(high)))
        return int(np.floor(value)) if option.integer else float(value)
    return int(rng.randint(int(low), int(high))) if option.integer else float(rng.uniform(low, high))


def distribution(option: Range) -> BaseDistribution:
    """Return a range as a distribution of Optuna."""
    if option.integer:
        return IntDistribution(int(option.low), int(option.high), log=option.log)
    return FloatDistribution(option.low, option.high, log=option.log)


def _seeds(arm: Arm, search: Search, tried: int) -> list[int]:
    """Return the seeds of an arm's search; a continued search does not repeat its first draws."""
    digest = hashlib.sha256("/".join((arm.task, arm.agent, arm.key.kind)).encode()).digest()
    return [int(word) for word in np.random.SeedSequence([search.seed, tried, *digest[:8]]).generate_state(4)]


class Tuned:
    """The Optuna study of one arm: it knows the configurations tried before, and its remaining budget."""

    def __init__(self, arm: Arm, search: Search, searched: Iterable[Cell], score: Score) -> None:
        self.arm = arm
        self._space = {name: distribution(option) for name, option in arm.ranges.items()}
        if len(arm.grid) > 1:
            for name in arm.grid[0]:
                self._space[name] = CategoricalDistribution(list(dict.fromkeys(values[name] for values in arm.grid)))
        self._fixed = dict(arm.grid[0]) if len(arm.grid) == 1 else {}
        tried = {cell.group: dict(cell.hyperparameters) for cell in searched}
        self.left = max(0, search.budget - len(tried))
        self._asked: dict[str, tuple[optuna.Trial, list[Cell]]] = {}
        sampler = optuna.samplers.TPESampler(seed=_seeds(arm, search, len(tried))[0])
        self._study = optuna.create_study(direction="maximize", sampler=sampler)
        for values in tried.values():
            auc = score(arm.cells(values))
            if auc is not None:
                self._study.add_trial(self._finished({name: values[name] for name in self._space}, auc))

    def _finished(self, params: Values, auc: float) -> optuna.trial.FrozenTrial:
        within = {name: self._rounded_into(name, value) for name, value in params.items()}
        return optuna.trial.create_trial(params=within, distributions=self._space, value=auc)

    def _rounded_into(self, name: str, value: Any) -> Any:
        """Return the value, or the end of its range if rounding to 12 digits has put it outside."""
        option = self.arm.ranges.get(name)
        return value if option is None else min(max(value, option.ends()[0]), option.ends()[1])

    def suggest(self) -> tuple[str, list[Cell]]:
        """Return (token, cells) of the next configuration."""
        token = str(self.left)
        self.left -= 1
        trial = self._study.ask(self._space)
        cells = self.arm.cells(self._fixed | {name: _plain(value) for name, value in trial.params.items()})
        self._asked[token] = trial, cells
        return token, cells

    def cells(self, token: str) -> list[Cell]:
        """Return the cells of a suggestion."""
        return self._asked[token][1]

    def tell(self, token: str, auc: float | None) -> None:
        """Record the AUC of a suggestion, once; None: its cells are not all done."""
        trial = self._asked[token][0]
        state = optuna.trial.TrialState.FAIL if auc is None else optuna.trial.TrialState.COMPLETE
        self._study.tell(trial, auc, state, skip_if_finished=True)


def _plain(value: Any) -> Any:
    """Return a numpy scalar as a Python one, rounded to 12 digits so that its text is exact."""
    value = value.item() if isinstance(value, np.generic) else value
    return float(f"{value:.12g}") if isinstance(value, float) else value
