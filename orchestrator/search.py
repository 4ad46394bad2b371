"""Which cells run next: the planned ones, then those that Tune's searchers ask for."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any

import numpy as np
import optuna
from ray import tune
from ray.tune.search import Searcher
from ray.tune.search.optuna import OptunaSearch

from orchestrator.plan import Pair, Values
from search_spaces import Range
from search_spaces.space import Search
from trainables.cell import Cell

optuna.logging.set_verbosity(optuna.logging.WARNING)

Score = Callable[[Sequence[Cell]], float | None]
"""Mean AUC of the cells of one configuration; None where one of them is not done."""


def domain(option: Range) -> Any:
    """A range as one of Tune's own domains."""
    if option.integer:
        return (tune.lograndint if option.log else tune.randint)(int(option.low), int(option.high) + 1)
    return (tune.loguniform if option.log else tune.uniform)(option.low, option.high)


def draw(pair: Pair, search: Search) -> list[Values]:
    """Random search: `budget` draws from the pair's ranges, the same ones each time; its grid is cycled through."""
    rng = np.random.RandomState(_seeds(pair, search, 0))
    draws = []
    for number in range(search.budget):
        values = {name: _plain(domain(option).sample(random_state=rng)) for name, option in pair.ranges.items()}
        draws.append(pair.grid[number % len(pair.grid)] | values)
    return draws


def _seeds(pair: Pair, search: Search, tried: int) -> list[int]:
    """Each pair draws its own numbers, and a search that goes on does not repeat its first ones."""
    digest = hashlib.sha256("/".join(pair.key).encode()).digest()
    return [int(word) for word in np.random.SeedSequence([search.seed, tried, *digest[:8]]).generate_state(4)]


class Tuned:
    """One pair under Optuna: its searcher, told of the configurations tried before, and what is left of its budget."""

    def __init__(self, pair: Pair, search: Search, searched: Iterable[Cell], score: Score) -> None:
        self.pair = pair
        space = {name: domain(option) for name, option in pair.ranges.items()}
        if len(pair.grid) > 1:
            space |= {name: tune.choice(list(dict.fromkeys(v[name] for v in pair.grid))) for name in pair.grid[0]}
        self._fixed = dict(pair.grid[0]) if len(pair.grid) == 1 else {}
        tried = {cell.group: dict(cell.hyperparameters) for cell in searched}
        self.left = max(0, search.budget - len(tried))
        self._searcher = OptunaSearch(
            OptunaSearch.convert_search_space(space), metric="auc", mode="max", seed=_seeds(pair, search, len(tried))[0]
        )
        for values in tried.values():
            auc = score(pair.cells(values))
            inside = all(option.low <= float(values[name]) <= option.high for name, option in pair.ranges.items())
            if auc is not None and inside:
                self._searcher.add_evaluated_point({name: values[name] for name in space}, auc)

    def suggest(self) -> tuple[str, list[Cell]]:
        """(token, cells) of the next configuration."""
        token = str(self.left)
        self.left -= 1
        suggestion = self._searcher.suggest(token) or {}
        return token, self.pair.cells(dict(self._fixed) | {name: _plain(value) for name, value in suggestion.items()})

    def tell(self, token: str, auc: float | None) -> None:
        """What became of a suggestion; None: its cells are not all done."""
        self._searcher.on_trial_complete(token, None if auc is None else {"auc": auc}, error=auc is None)


class Proposals(Searcher):
    """The queue of a stage as a Tune search algorithm: packs of cells are made into trials as workers get free.

    A worker gets the cells of one pack; the cells of one suggested configuration are a pack of their own.
    """

    def __init__(
        self,
        packs: Sequence[Sequence[Cell]],
        tuned: Sequence[Tuned],
        ended: Callable[[Cell], bool],
        score: Score,
        at_once: int,
    ) -> None:
        super().__init__(metric="auc", mode="max")
        self._packs = list(reversed(packs))
        self._tuned = list(tuned)
        self._ended = ended
        self._score = score
        self._at_once = at_once
        self._running: dict[str, tuple[Tuned, str, list[Cell]]] = {}

    def suggest(self, trial_id: str) -> Any:
        """The config of the next trial, None to wait, or FINISHED."""
        if self._packs:
            return {"cells": [cell.to_json() for cell in self._packs.pop()]}
        while open_pairs := [tuned for tuned in self._tuned if tuned.left > 0]:
            if len(self._running) >= self._at_once:
                return None
            tuned = max(open_pairs, key=lambda candidate: candidate.left)
            token, cells = tuned.suggest()
            missing = [cell for cell in cells if not self._ended(cell)]
            if missing:
                self._running[trial_id] = tuned, token, cells
                return {"cells": [cell.to_json() for cell in missing]}
            tuned.tell(token, self._score(cells))
        return None if self._running else Searcher.FINISHED

    def on_trial_complete(self, trial_id: str, result: Mapping[str, Any] | None = None, error: bool = False) -> None:
        """Tell the pair's searcher the mean AUC of the configuration that has ended."""
        if trial_id in self._running:
            tuned, token, cells = self._running.pop(trial_id)
            tuned.tell(token, self._score(cells))

    def save(self, checkpoint_path: str) -> None:
        """Nothing: a sweep resumes from its records."""

    def restore(self, checkpoint_path: str) -> None:
        """Nothing: see `save`."""


def _plain(value: Any) -> Any:
    """A numpy scalar as a Python one, rounded to 12 digits so that its text is exact."""
    value = value.item() if isinstance(value, np.generic) else value
    return float(f"{value:.12g}") if isinstance(value, float) else value
