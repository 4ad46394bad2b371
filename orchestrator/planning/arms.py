"""An arm: one task, agent and source with its configurations, over all seeds."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from search_spaces.domains import Range
from trainables.cell import Cell, Source

Values = dict[str, Any]


Key = tuple[str, str, str]
"""(task, agent, kind of source: learned, exact or none)."""


Params = Mapping[Key, Values]
"""Hyperparameters that are settled already, e.g. by an exported file."""


def key_of(cell: Cell) -> Key:
    """(task, agent, kind of source) of a cell."""
    return cell.task, cell.agent, cell.sources[0].kind if cell.sources else "none"


@dataclass(frozen=True)
class Pair:
    """An agent on a task, with one kind of source: what is tuned together, over all seeds."""

    agent: str
    task: str
    seeds: tuple[int, ...]
    grid: tuple[Values, ...]
    """Configurations to try; with ranges, what goes with every draw from them."""
    ranges: Mapping[str, Range] = field(default_factory=dict)
    sources: Mapping[int, Source] = field(default_factory=dict)
    """Seed to source; empty for an agent without one."""
    libraries: Mapping[int, tuple[Source, ...]] = field(default_factory=dict)
    """Seed to further sources; empty for an agent that takes one."""

    @property
    def key(self) -> Key:
        """(task, agent, kind of source)."""
        kinds = {source.kind for source in self.sources.values()}
        return self.task, self.agent, kinds.pop() if kinds else "none"

    @property
    def swept(self) -> set[str]:
        """The hyperparameters that are tried or settled here."""
        return {*self.ranges, *(name for values in self.grid for name in values)}

    def owns(self, cell: Cell) -> bool:
        """Whether the cell is one of this pair: its task, agent, seeds and sources."""
        return key_of(cell) == self.key and cell.seed in self.seeds and cell.sources == self._sources(cell.seed)

    def cells(self, values: Values) -> list[Cell]:
        """One cell per seed with these hyperparameters."""
        return [Cell.create(self.agent, self.task, seed, values, self._sources(seed)) for seed in self.seeds]

    def _sources(self, seed: int) -> tuple[Source, ...]:
        first = (self.sources[seed],) if seed in self.sources else ()
        return (*first, *self.libraries.get(seed, ()))

    def all_cells(self) -> list[Cell]:
        """The cells of the whole grid; none for a pair with ranges, whose cells come up as it is searched."""
        return [] if self.ranges else [cell for values in self.grid for cell in self.cells(values)]
