"""Searching ranges of hyperparameters: random draws, and Optuna by Tune's searcher."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Iterable, Sequence
from typing import Any

import numpy as np
import optuna
from ray import tune
from ray.tune.search.optuna import OptunaSearch

from orchestrator.planning.arms import Pair, Values
from search_spaces.domains import Range
from search_spaces.search_space import Search
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
        self._asked: dict[str, list[Cell]] = {}
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
        values = dict(self._fixed) | {name: _plain(value) for name, value in suggestion.items()}
        self._asked[token] = self.pair.cells(values)
        return token, self._asked[token]

    def cells(self, token: str) -> list[Cell]:
        """The cells of a suggestion."""
        return self._asked[token]

    def tell(self, token: str, auc: float | None) -> None:
        """What became of a suggestion; None: its cells are not all done."""
        self._searcher.on_trial_complete(token, None if auc is None else {"auc": auc}, error=auc is None)


def _plain(value: Any) -> Any:
    """A numpy scalar as a Python one, rounded to 12 digits so that its text is exact."""
    value = value.item() if isinstance(value, np.generic) else value
    return float(f"{value:.12g}") if isinstance(value, float) else value
