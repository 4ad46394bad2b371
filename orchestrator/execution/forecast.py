"""The forecast of a sweep: its stages, their cells, how many are done, and the cost of the rest."""

from __future__ import annotations

import logging
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from orchestrator.execution.cells.ledger import Ledger
from orchestrator.execution.cells.longer import Longer
from orchestrator.execution.cells.sequential import needed, needed_at_most, test
from orchestrator.execution.settings import Settings
from orchestrator.execution.sources.needed_networks import spare
from orchestrator.execution.sources.source_choice import choose
from orchestrator.execution.sources.source_ranking import ranked
from orchestrator.planning.arms import CONFIRM, Arm, distinct
from orchestrator.planning.confirmation import (
    CONFIRM_SOURCE,
    Chosen,
    check_confirmation,
    confirm_arms,
    expected_arms,
    with_unseen,
)
from orchestrator.planning.extras import require_runnable
from orchestrator.planning.plan import SOURCE, TRANSFER, source_arms, transfer_arms
from orchestrator.planning.source_choice import PLACEHOLDER_STEPS, Choices, SourceChoice, settle, untrained
from orchestrator.results.status import sweeps
from orchestrator.results.sweep_folder import Results
from search_spaces.search_space import SearchSpace
from trainables.cell import Cell
from trainables.errors import InputError
from trainables.plugins.loader import describe_error
from trainables.tasks.registry import parse_task
from trainables.training.throughput import Rate, measure

log = logging.getLogger("deltatune.forecast")

SIZES = ("hidden_size", "hidden_layers", "batch_size", "evaluate_every", "evaluation_episodes", "module", "device")
"""Hyperparameters that determine how long an episode takes."""

START_SECONDS = {"ray": 10.0, "local": 2.0}
"""Seconds before the first cell runs, and between the stages: imports, Ray, workers."""

PUBLISH_SECONDS, PUBLISH_SECONDS_PER_CELL = 6.0, 0.04
"""Seconds for tables, figures, the report and MLflow at the end: per sweep, and per cell."""

Key = tuple[str, str, tuple[Any, ...]]


@dataclass(frozen=True)
class Cost:
    """The cost of an episode for an agent on a task, evaluations included."""

    agent: str
    task: str
    low: float
    """Seconds of an episode with the fewest steps seen."""
    high: float
    """Seconds of an episode with the most steps seen."""
    origin: str
    """The basis of the estimate: earlier cells, or a measurement now."""


@dataclass(frozen=True)
class Stage:
    """One stage of a forecast."""

    stage: str
    cells: int
    """With `seeds: auto` those that the sequential test needs at least."""
    done: int
    """Cells that have ended and will not run again."""
    low: float
    """Seconds on one worker for the rest."""
    high: float
    most: int
    """Cells at most; more than `cells` where a sequential test may go on."""
    taken: Mapping[str, int] = field(default_factory=dict)
    """How many of the done ones are copied, by the sweep that has trained them; sources: by 'the source library'."""
    longer: Longer = field(default_factory=Longer)
    """What cells save that continue shorter ones."""


@dataclass(frozen=True)
class Forecast:
    """What a sweep would run, and its cost."""

    stages: tuple[Stage, ...]
    costs: tuple[Cost, ...]
    unknown: tuple[str, ...]
    """Why the cost of some cells is unknown."""
    workers: int
    start: float
    """Seconds to start up; 0 where nothing is left to run."""
    publish: float
    """Seconds for tables, figures and MLflow."""

    @property
    def wall(self) -> tuple[float, float]:
        """Seconds (low, high) from the command to the report: starting, cells on all workers, publishing."""
        low, high = (sum(side) / self.workers for side in zip(*((s.low, s.high) for s in self.stages), strict=True))
        return low + self.start + self.publish, high + self.start + self.publish


def forecast(space: SearchSpace, settings: Settings, results: Results, workers: int) -> Forecast:
    """Return the forecast of a sweep into the folder of `results`, which need not exist. Writes nothing.

    Each agent and task family without a record in the same storage is measured for about two seconds.
    Raises InputError where a task or an agent needs an extra that is not installed.
    """
    require_runnable(space)
    ledger = Ledger(results, settings.retry_failed, space, reads_only=True, reuse=settings.reuse)
    costs = _Costs(results.storage)
    arms = source_arms(space, settings.params)
    keep = any("learned" in scenario.source.kinds for scenario in space.scenarios)
    trained = distinct(arm for scenario in arms for arm in scenario.values() if arm.task not in settings.pretrained)
    spare(space, settings, ledger)
    first = _stage(SOURCE, trained, space, ledger, costs, keep)
    choices = settle(arms, settings.pretrained, lambda arm: _choice(ledger, arm))
    choices = ranked(space, choices, results, writes=False)
    transfers = transfer_arms(space, choices, settings.params)
    if space.sequential:
        second = _by_groups(transfers, space, results, ledger, costs)
    else:
        second = _stage(TRANSFER, transfers, space, ledger, costs, keep=False)
    stages = [first, second]
    if space.confirm:
        over = all(stage.cells == stage.done and not stage.taken for stage in stages) and not ledger.damage
        found = _chosen(results) if over and ledger.planned(TRANSFER) else None
        stages += _confirmation(space, settings, choices, transfers, found, ledger, costs)
    cells, left = (sum(each) for each in zip(*((s.cells, s.cells - s.done) for s in stages), strict=True))
    return Forecast(
        tuple(stages),
        tuple(costs.known.values()),
        tuple(dict.fromkeys(costs.unknown)),
        workers,
        start=START_SECONDS["local" if settings.local else "ray"] if left else 0.0,
        publish=PUBLISH_SECONDS + PUBLISH_SECONDS_PER_CELL * cells,
    )


def _chosen(results: Results) -> Chosen:
    from orchestrator.analysis.confirmation import chosen

    return chosen(results.rows())


def _confirmation(
    space: SearchSpace,
    settings: Settings,
    choices: Sequence[Choices],
    transfers: Sequence[Arm],
    found: Chosen | None,
    ledger: Ledger,
    costs: _Costs,
) -> list[Stage]:
    """Return the stages of the confirmation: of what is selected, or of as many configurations where nothing is yet."""
    check_confirmation(space, settings.pretrained)
    by_task, arms = expected_arms(space, choices, transfers, settings.params, settings.pretrained)
    sources = distinct(arm for each in by_task for arm in each.values())
    stages = [_stage(CONFIRM_SOURCE, sources, space, ledger, costs, keep=True)] if sources else []
    if found is not None and all(stage.cells == stage.done for stage in stages):
        arms = confirm_arms(space, with_unseen(choices, by_task, ledger.source_runs), settings.params, found)
    return [*stages, _stage(CONFIRM, arms, space, ledger, costs, keep=False)]


def _stage(stage: str, arms: Sequence[Arm], space: SearchSpace, ledger: Ledger, costs: _Costs, keep: bool) -> Stage:
    sound = [arm for arm in arms if not arm.lost]
    cells = list({cell.id: cell for arm in sound for cell in arm.all_cells()}.values())
    taken = ledger.take_over(stage, cells, keep)
    missing = [cell for cell in cells if not ledger.ended(cell, keep)]
    longer, _, before = ledger.shorter().of(missing)
    count, done = len(cells), len(cells) - len(missing)
    for arm in (arm for arm in sound if arm.ranges):
        asked, found = space.search.budget * arm.width, len(ledger.searched(arm))
        count, done = count + asked, done + min(found, asked)
        missing += arm.cells(arm.first())[:1] * max(asked - found, 0)
    low, high = costs.of(missing, before)
    return Stage(stage, count, done, low, high, count, taken, longer)


def _by_groups(arms: Sequence[Arm], space: SearchSpace, results: Results, ledger: Ledger, costs: _Costs) -> Stage:
    """Return the transfers of a sequential test over seeds: the groups that it needs so far, and the most."""
    sound = [arm for arm in arms if not arm.lost]
    tested = test(space, results) if ledger.planned(TRANSFER) and not ledger.damage else None
    least = {cell.id: cell for cell in needed(space, sound, tested.looks if tested else {})}
    most = {cell.id: cell for cell in needed_at_most(space, sound, tested)} | least
    taken = ledger.take_over(TRANSFER, least.values(), keep=False)
    missing = [[cell for cell in cells.values() if not ledger.ended(cell)] for cells in (least, most)]
    longer, _, before = ledger.shorter().of(missing[0])
    low, high = costs.of(missing[0], before)[0], costs.of(missing[1], before)[1]
    return Stage(TRANSFER, len(least), len(least) - len(missing[0]), low, high, len(most), taken, longer)


def _choice(ledger: Ledger, arm: Arm) -> SourceChoice:
    """Return the outcome of stage 1 if its cells have ended, else a placeholder; its transfer cells match no record.

    A recorded source whose network is not in the library trains again, to the same outcome.
    """
    cells = arm.all_cells() or ledger.searched(arm)
    if cells and all(map(ledger.ended, cells)):
        return choose(ledger, arm, cells)
    return untrained(arm, steps=PLACEHOLDER_STEPS)


class _Costs:
    """The costs of cells, from the records of a storage folder, else measured once per agent and task family."""

    def __init__(self, storage: Path) -> None:
        self._recorded = _recorded(storage)
        self._rates: dict[Key, Rate | None] = {}
        self.known: dict[Key, Cost] = {}
        self.unknown: list[str] = []

    def of(self, cells: Iterable[Cell], before: Mapping[str, int]) -> tuple[float, float]:
        """Return the seconds (low, high) of all `cells` on one worker. before: episodes trained already, by cell id."""
        low = high = 0.0
        for cell in cells:
            cost = self._cost(cell)
            episodes = cell.episodes - before.get(cell.id, 0)
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
                log.info("the speed of %s on %s cannot be measured", cell.agent, cell.task, exc_info=error)
                self._rates[family] = None
                self.unknown.append(f"{cell.agent} on {cell.task}: {describe_error(error)}")
        rate = self._rates[family]
        if rate is None:
            return Cost(cell.agent, cell.task, 0.0, 0.0, "not known")
        episodes = int(values["episodes"])
        low, high = (rate.seconds(values, steps) / episodes for steps in (None, float(rate.time_limit)))
        return Cost(cell.agent, cell.task, low, high, "measured now")


def _recorded(storage: Path) -> dict[Key, list[float]]:
    """Return the seconds per episode of every done cell in a storage folder; damaged sweeps are skipped."""
    found: dict[Key, list[float]] = {}
    for results in sweeps(storage, None):
        try:
            heads = [head for head in results.heads().values() if head.status == "done"]
        except InputError as error:
            log.warning("%s is skipped in the estimate of costs: %s", results.folder, error)
            continue
        for head in heads:
            key = _key(head.cell.agent, head.cell.task, head.cell.hyperparameters)
            found.setdefault(key, []).append(head.seconds / head.cell.episodes)
    return found


def _key(agent: str, task: str, values: Any) -> Key:
    return agent, task, tuple(values.get(name) for name in SIZES)
