"""What a sweep would do: its stages, their cells, what is done already, and what the rest would cost."""

from __future__ import annotations

import json
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from orchestrator.errors import SweepError
from orchestrator.execution.ledger import Ledger
from orchestrator.execution.settings import Settings
from orchestrator.execution.source_choice import choose
from orchestrator.planning import source_choice
from orchestrator.planning.arms import Pair
from orchestrator.planning.plan import SOURCE, TRANSFER, source_pairs, transfer_pairs
from orchestrator.planning.source_choice import SourceChoice, SourceRun
from orchestrator.results.status import sweeps
from orchestrator.results.sweep_folder import Results
from search_spaces.search_space import SearchSpace
from trainables.cell import Cell
from trainables.plugins.loader import in_words
from trainables.tasks.registry import parse_task
from trainables.training.throughput import Rate, measure

SIZES = ("hidden_size", "hidden_layers", "batch_size", "evaluate_every", "evaluation_episodes", "module", "device")
"""Hyperparameters that decide how long an episode takes."""

Key = tuple[str, str, tuple[Any, ...]]


@dataclass(frozen=True)
class Cost:
    """What an episode costs, for an agent on a task, evaluations included."""

    agent: str
    task: str
    low: float
    """Seconds of one episode: with the fewest steps seen."""
    high: float
    """Seconds of one episode: with the most."""
    origin: str
    """Where this is from: earlier cells, or a measurement now."""


@dataclass(frozen=True)
class Stage:
    """One stage of a forecast."""

    stage: str
    cells: int
    done: int
    """Cells that have ended and will not run again."""
    low: float
    """Seconds on one worker for the rest."""
    high: float


@dataclass(frozen=True)
class Forecast:
    """What a sweep would do."""

    stages: tuple[Stage, ...]
    costs: tuple[Cost, ...]
    unknown: tuple[str, ...]
    """Why the cost of some cells is not known."""
    workers: int

    @property
    def wall(self) -> tuple[float, float]:
        """Seconds on all workers, from and to."""
        return (
            sum(stage.low for stage in self.stages) / self.workers,
            sum(stage.high for stage in self.stages) / self.workers,
        )


def forecast(space: SearchSpace, settings: Settings, results: Results, workers: int) -> Forecast:
    """The forecast of a sweep into the folder of `results`, which need not be there. Writes nothing.

    Measures for about two seconds each agent and task family of which no sweep in the same storage has a record.
    """
    ledger, costs = Ledger(results, settings.retry_failed, space), _Costs(results.storage)
    sources = source_pairs(space, settings.params)
    keep = any("learned" in scenario.source.kinds for scenario in space.scenarios)
    trained = [pair for pair in sources if pair is not None and pair.task not in settings.given]
    first = _stage(SOURCE, trained, space, ledger, costs, keep)
    choices = [
        SourceChoice({}, {})
        if pair is None
        else _choice(ledger, pair, keep)
        if pair in trained
        else source_choice.choice(pair, settings.given[pair.task])
        for pair in sources
    ]
    second = _stage(TRANSFER, transfer_pairs(space, choices, settings.params), space, ledger, costs, keep=False)
    return Forecast((first, second), tuple(costs.known.values()), tuple(dict.fromkeys(costs.unknown)), workers)


def _stage(stage: str, pairs: Sequence[Pair], space: SearchSpace, ledger: Ledger, costs: _Costs, keep: bool) -> Stage:
    cells = list({cell.id: cell for pair in pairs for cell in pair.all_cells()}.values())
    missing = [cell for cell in cells if not ledger.ended(cell, keep)]
    count, done = len(cells), len(cells) - len(missing)
    for pair in (pair for pair in pairs if pair.ranges):
        asked, found = space.search.budget * len(pair.seeds), len(ledger.searched(pair))
        count, done = count + asked, done + min(found, asked)
        missing += pair.cells(_first(pair))[:1] * max(asked - found, 0)
    low, high = costs.of(missing)
    return Stage(stage, count, done, low, high)


def _choice(ledger: Ledger, pair: Pair, keep: bool) -> SourceChoice:
    """The outcome of stage 1 where its cells have ended; else a stand-in, whose transfer cells are none that exist."""
    cells = pair.all_cells() or ledger.searched(pair)
    if cells and all(ledger.ended(cell, keep) for cell in cells):
        try:
            return choose(ledger, pair, cells)
        except SweepError:
            pass
    values = _first(pair)
    best = {name: value for name, value in values.items() if name in pair.swept}
    return SourceChoice(best, {cell.seed: SourceRun(cell, 0.0, 0.0, 10_000_000) for cell in pair.cells(values)})


def _first(pair: Pair) -> dict[str, Any]:
    """One of the pair's configurations."""
    return pair.grid[0] | {name: option.ends()[0] for name, option in pair.ranges.items()}


class _Costs:
    """The costs of cells: from the records of a storage folder, else measured, each agent and task family once."""

    def __init__(self, storage: Path) -> None:
        self._recorded = _recorded(storage)
        self._rates: dict[Key, Rate | None] = {}
        self.known: dict[Key, Cost] = {}
        self.unknown: list[str] = []

    def of(self, cells: Iterable[Cell]) -> tuple[float, float]:
        """Seconds of all `cells` on one worker, from and to."""
        low = high = 0.0
        for cell in cells:
            cost = self._cost(cell)
            episodes = float(cell.hyperparameters["episodes"])
            low, high = low + episodes * cost.low, high + episodes * cost.high
        return low, high

    def _cost(self, cell: Cell) -> Cost:
        key = _key(cell.agent, cell.task, cell.hyperparameters)
        if key not in self.known:
            self.known[key] = self._from_records(key) or self._measured(cell)
        return self.known[key]

    def _from_records(self, key: Key) -> Cost | None:
        seen = self._recorded.get(key)
        if not seen:
            return None
        low, high = (float(np.quantile(seen, at)) for at in (0.1, 0.9))
        return Cost(key[0], key[1], low, high, f"{len(seen)} earlier cells")

    def _measured(self, cell: Cell) -> Cost:
        values = dict(cell.hyperparameters)
        family = _key(cell.agent, parse_task(cell.task).family.name, values)
        if family not in self._rates:
            try:
                self._rates[family] = measure(cell)
            except Exception as error:
                self._rates[family] = None
                self.unknown.append(f"{cell.agent} on {cell.task}: {in_words(error)}")
        rate = self._rates[family]
        if rate is None:
            return Cost(cell.agent, cell.task, 0.0, 0.0, "not known")
        episodes = int(values["episodes"])
        low, high = (rate.seconds(values, steps) / episodes for steps in (None, float(rate.time_limit)))
        return Cost(cell.agent, cell.task, low, high, "measured now")


def _recorded(storage: Path) -> dict[Key, list[float]]:
    """Seconds an episode of every done cell of the sweeps in a storage folder."""
    found: dict[Key, list[float]] = {}
    for results in sweeps(storage, None):
        cells, _ = results.tables()
        for row in cells[cells["status"] == "done"].itertuples() if len(cells) else ():
            values = json.loads(str(row.hyperparameters))
            key = _key(str(row.agent), str(row.task), values)
            found.setdefault(key, []).append(float(str(row.seconds)) / values["episodes"])
    return found


def _key(agent: str, task: str, values: Any) -> Key:
    return agent, task, tuple(values.get(name) for name in SIZES)
