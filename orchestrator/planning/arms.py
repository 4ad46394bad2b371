"""Arms: a task, an agent and its sources, with the configurations to try over all seeds."""

from __future__ import annotations

import functools
from collections import defaultdict
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any, NamedTuple

from search_spaces.domains import Range
from search_spaces.source_space import default_pick
from trainables.agents.registry import agent_named
from trainables.cell import Cell, Source, content_id
from trainables.tasks.registry import parse_task

Values = dict[str, Any]

Sources = tuple[Source, ...]
"""What one cell knows: one source, or several for an agent that chooses among them."""

UNAIDED: tuple[Sources, ...] = ((),)
"""What a seed of an agent without transfer is crossed with."""


class Key(NamedTuple):
    """Identifies an arm within a sweep."""

    task: str
    agent: str
    source_task: str = ""
    """Empty for an agent without transfer, unless several sources have settled different baselines."""
    kind: str = "none"
    """learned, exact or none."""
    pick: str = ""
    """Which source's knowledge a seed gets (learned sources)."""


Params = Mapping[Key, Values]
"""Hyperparameters that are settled beforehand, for instance by an exported file."""


def entry_of(params: Params, key: Key) -> Key | None:
    """Return the entry of `params` for an arm, or None. An entry without pick or source task applies to all of them."""
    entries = (key, key._replace(pick=""), key._replace(source_task=""), key._replace(source_task="", pick=""))
    return next((entry for entry in entries if entry in params), None)


CONFIRM = "confirm"
"""The purpose of an arm, and the stage, that confirms what was selected."""


class Label(NamedTuple):
    """What an arm knows about its cells beyond their own content."""

    pick: str = ""
    baseline_for: str = ""
    purpose: str = ""


PLAIN = Label()


def configuration_id(cell: Cell, label: Label) -> str:
    """Return the id that the cells of a configuration share; a cell of two arms belongs to a configuration of each."""
    usual = ("", default_pick(cell.sources[0].task) if cell.sources else "")
    if label.pick in usual and not label.baseline_for and not label.purpose:
        return cell.group
    said = (label.pick, label.baseline_for, *([label.purpose] if label.purpose else []))
    return content_id([cell.group, *said])


@dataclass(frozen=True)
class Arm:
    """One (task, agent, source) with its configurations, which are tuned together over all seeds."""

    agent: str
    task: str
    seeds: tuple[int, ...]
    grid: tuple[Values, ...] = ({},)
    """Configurations to try; with ranges, the values that complete each draw."""
    ranges: Mapping[str, Range] = field(default_factory=dict)
    sources: Mapping[int, tuple[Sources, ...]] = field(default_factory=dict)
    """Seed to the sources of each of its cells: one cell, or one for every source network that the seed is crossed
    with (pick: each). Empty for an agent without transfer."""
    pick: str = ""
    """Which source's knowledge a seed gets; empty without a learned source."""
    baseline_for: str = ""
    """The source task whose stage 1 has settled this baseline, if other sources have settled different ones."""
    purpose: str = ""
    """CONFIRM where its seeds have no part in selecting a configuration; else empty."""
    lost: str = ""
    """Why it cannot run: one of its sources has failed."""

    @property
    def key(self) -> Key:
        """(task, agent, source task, kind, pick)."""
        if not self.sources:
            return Key(self.task, self.agent, self.baseline_for)
        first = next(iter(self.sources.values()))[0][0]
        return Key(self.task, self.agent, first.task, first.kind, self.pick)

    @property
    def label(self) -> Label:
        """The label of the arm's cells."""
        return Label(self.pick, self.baseline_for, self.purpose)

    @functools.cached_property
    def content(self) -> str:
        """A hash of everything that the arm would train; arms with the same hash are the same."""
        ranges = {name: option.model_dump() for name, option in self.ranges.items()}
        sources = {
            str(seed): [[source.model_dump() for source in one] for one in crossed]
            for seed, crossed in self.sources.items()
        }
        return content_id([self.agent, self.task, list(self.seeds), list(self.grid), ranges, sources, self.pick])

    @property
    def swept(self) -> set[str]:
        """The hyperparameters that the arm tries or has settled."""
        return {*self.ranges, *(name for values in self.grid for name in values)}

    def owns(self, cell: Cell) -> bool:
        """Return whether the cell belongs to this arm: its values are those of the grid, or lie within the ranges."""
        return (
            (cell.task, cell.agent) == (self.task, self.agent)
            and cell.seed in self.seeds
            and cell.sources in self.sources.get(cell.seed, UNAIDED)
            and self._fixed(cell.hyperparameters) in self._configurations
            and all(_inside(option, cell.hyperparameters[name]) for name, option in self.ranges.items())
        )

    def first(self) -> Values:
        """Return one of the arm's configurations."""
        return self.grid[0] | {name: option.ends()[0] for name, option in self.ranges.items()}

    def cells(self, values: Values) -> list[Cell]:
        """Return the cells of a configuration: one per seed, or per seed and source network."""
        return [
            Cell.create(self.agent, self.task, seed, values, sources)
            for seed in self.seeds
            for sources in self.sources.get(seed, UNAIDED)
        ]

    @property
    def width(self) -> int:
        """How many cells a configuration has."""
        return sum(len(self.sources.get(seed, UNAIDED)) for seed in self.seeds)

    def all_cells(self) -> list[Cell]:
        """Return the cells of the whole grid; none for an arm with ranges, whose cells the search creates."""
        return [] if self.ranges else [cell for values in self.grid for cell in self.cells(values)]

    def some_cells(self) -> list[Cell]:
        """Return the cells of the grid, or of one configuration from the ranges."""
        return self.all_cells() or self.cells(self.first())

    def _fixed(self, values: Mapping[str, Any]) -> tuple[tuple[str, Any], ...]:
        return tuple(sorted((name, value) for name, value in values.items() if name not in self.ranges))

    @functools.cached_property
    def _configurations(self) -> frozenset[tuple[tuple[str, Any], ...]]:
        agent, task, drawn = agent_named(self.agent), parse_task(self.task), self.first()
        full = (agent.resolve(task, drawn | values).model_dump() for values in self.grid)
        return frozenset(self._fixed(values) for values in full)


def labels_of(arms: Iterable[Arm], cells: Iterable[Cell]) -> dict[str, list[Label]]:
    """Return cell id to the labels of its arms, without the cells for which every label is plain."""
    candidates: dict[tuple[str, str], list[Arm]] = defaultdict(list)
    for arm in arms:
        candidates[arm.task, arm.agent].append(arm)
    found = {}
    for cell in cells:
        labels = list(dict.fromkeys(arm.label for arm in candidates[cell.task, cell.agent] if arm.owns(cell)))
        if labels not in ([], [PLAIN]):
            found[cell.id] = labels
    return found


def _inside(option: Range, value: Any) -> bool:
    """Return whether a value, rounded to 12 digits, lies in the range."""
    if not isinstance(value, int | float):
        return False  # e.g. threshold: auto
    room = 1e-9 * max(abs(option.low), abs(option.high))
    return option.low - room <= value <= option.high + room


def distinct(arms: Iterable[Arm]) -> list[Arm]:
    """Return each arm once, preferring one that can run; baselines name their source where that is ambiguous."""
    found: dict[str, Arm] = {}
    for arm in arms:
        if arm.content not in found or found[arm.content].lost:
            found[arm.content] = arm
    kept = list(found.values())
    baselines = [(arm.task, arm.agent) for arm in kept if not arm.sources]
    return [
        replace(arm, baseline_for="") if baselines.count((arm.task, arm.agent)) == 1 and arm.baseline_for else arm
        for arm in kept
    ]
