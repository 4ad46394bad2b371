"""Cells that are longer than ones that have ended: which of them continue these, and why others start anew."""

from __future__ import annotations

import functools
import logging
from collections import Counter, defaultdict
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple

from orchestrator.results.other_sweeps import OtherSweeps, same_versions
from orchestrator.results.records.record import Head
from trainables.cell import Cell, content_id
from trainables.storage.paths import is_local, sizes
from trainables.training.end_states import NAME, name_of, why_anew

LEAST_SECONDS, LEAST_SECONDS_REMOTE = 0.05, 2.0
"""Shortest cells whose end state is kept on a disk, where writing it takes some milliseconds, and at a URL."""

OTHER_SOURCE = (
    "they learn from another source network now (to train only the transfers longer, give their source its "
    "own episodes, in its hyperparameters)"
)
OTHER_VERSIONS = "the shorter ones ran with other versions of the packages"
NO_STATE = (
    "no end state of the shorter ones is there (they took no time, or more of the disk than --keep-states leaves)"
)


log = logging.getLogger("deltatune.sweep")


@dataclass(frozen=True)
class Longer:
    """What longer cells save by continuing shorter ones."""

    cells: int = 0
    """Cells that continue."""
    episodes: int = 0
    """Episodes of these cells, from the first one."""
    saved: int = 0
    """How many of these episodes are trained already."""
    anew: Mapping[str, int] = field(default_factory=dict)
    """Why other longer cells start anew: a clause, and how many do."""

    def sentences(self) -> list[str]:
        """Return what this means, in sentences for the user."""
        said = []
        if self.cells:
            verb = "cell continues a shorter one" if self.cells == 1 else "cells continue shorter ones"
            said = [f"{self.cells:,} {verb}: {self.saved:,} of {self.episodes:,} episodes are trained already"]
        for why, count in self.anew.items():
            said.append(f"{count:,} longer {'cell starts' if count == 1 else 'cells start'} anew: {why}")
        return said


Places = Mapping[str, Sequence[tuple[int, str]]]
"""Lineage to (episodes, path) of end states."""


class Found(NamedTuple):
    """What is known about longer cells."""

    longer: Longer
    known: Places
    """The end states that they continue."""
    before: Mapping[str, int]
    """Cell id to how many of its episodes are trained already."""


@dataclass
class _Ended:
    """The done cells of one agent, task and seed. What is costly is computed where one of them is short enough."""

    cells: list[Cell] = field(default_factory=list)

    def shorter(self, cell: Cell) -> list[Cell]:
        """Return those that differ from a cell only in having fewer episodes, the longest first."""
        if self._least >= cell.episodes:
            return []
        alike = [each for each in self._by_lineage.get(cell.lineage, ()) if each.episodes < cell.episodes]
        return sorted(alike, key=lambda each: each.episodes, reverse=True)

    def with_another_source(self, cell: Cell) -> bool:
        """Return whether one of them differs from a cell only in having fewer episodes and another source network."""
        if not cell.sources or self._least >= cell.episodes:
            return False
        return self._but_source.get(_but_source(cell), cell.episodes) < cell.episodes

    @functools.cached_property
    def _least(self) -> int:
        return min(cell.episodes for cell in self.cells)

    @functools.cached_property
    def _by_lineage(self) -> dict[str, list[Cell]]:
        found = defaultdict(list)
        for cell in self.cells:
            found[cell.lineage].append(cell)
        return found

    @functools.cached_property
    def _but_source(self) -> dict[str, int]:
        """The least episodes by what `_but_source` says of a cell."""
        found: dict[str, int] = {}
        for cell in self.cells:
            key = _but_source(cell)
            found[key] = min(cell.episodes, found.get(key, cell.episodes))
        return found


class Shorter:
    """The ended cells of a storage with their end states, which longer cells may continue."""

    def __init__(self, heads: Mapping[str, Head], folder: Path, others: OtherSweeps | None) -> None:
        """heads: the records of the sweep. folder: its end states. others: further sweeps that may be used."""
        self._heads, self._folder, self._others = heads, folder, others
        self._here: set[str] | None = None
        self._elsewhere: dict[str, list[tuple[int, Path]]] | None = None
        self._groups: dict[tuple[str, str, int], _Ended] | None = None

    def of(self, cells: Iterable[Cell]) -> Found:
        """Return what is known about those of `cells` that are longer than ended ones."""
        known: dict[str, list[tuple[int, str]]] = {}
        before: dict[str, int] = {}
        anew: Counter[str] = Counter()
        episodes = 0
        for cell in cells:
            found = self._longest(cell)
            if isinstance(found, str):
                anew[found] += 1
            elif found is not None:
                places = known.setdefault(cell.lineage, [])
                places += [found] if found not in places else []
                before[cell.id] = found[0]
                episodes += cell.episodes
        return Found(Longer(len(before), episodes, sum(before.values()), dict(anew)), known, before)

    def of_kinds(self, kinds: set[tuple[str, str]]) -> Places:
        """Return all usable end states of the sweep's cells of some (agent, task), by lineage: for cells to come."""
        known: dict[str, list[tuple[int, str]]] = defaultdict(list)
        for head in self._heads.values():
            cell = head.cell
            if (cell.agent, cell.task) in kinds and head.status == "done" and not self._unusable(cell):
                known[cell.lineage].append((cell.episodes, str(self._folder / name_of(cell))))
        return dict(known)

    def outgrown(self, cells: Iterable[Cell], known: Places) -> list[Path]:
        """Return the sweep's end states that no cell needs any more, as the end state of a longer one is there too."""
        found: dict[str, Path] = {}
        for cell in cells if known else ():
            head = self._heads.get(cell.id)
            if head is None or head.status != "done" or not known.get(cell.lineage) or self._unusable(cell):
                continue
            shorter = [Path(path).name for count, path in known[cell.lineage] if count < cell.episodes]
            found |= {name: self._folder / name for name in shorter if name in self._states()}
        return list(found.values())

    def _longest(self, cell: Cell) -> tuple[int, str] | str | None:
        """Return (episodes, path) of what a cell continues, why it starts anew, or None where no shorter one ended."""
        group = self._ended().get((cell.agent, cell.task, cell.seed))
        alike = group.shorter(cell) if group else []
        whys = [(self._unusable(each), each) for each in alike]
        here = next((each for why, each in whys if not why), None)
        longest = here.episodes if here else 0
        for episodes, path in sorted(self._elsewhere_of(cell), key=lambda place: -place[0]):
            sibling = cell.with_episodes(episodes)
            usable = episodes > longest and not why_anew(sibling)
            if usable and self._others is not None and self._others.find(sibling) is not None:
                return episodes, str(path)
        if here:
            return longest, str(self._folder / name_of(here))
        if whys:
            return whys[0][0]
        return OTHER_SOURCE if group and group.with_another_source(cell) else None

    def _ended(self) -> dict[tuple[str, str, int], _Ended]:
        """Return the done cells of the sweep by agent, task and seed."""
        if self._groups is None:
            self._groups = defaultdict(_Ended)
            for head in self._heads.values():
                if head.status == "done":
                    self._groups[head.cell.agent, head.cell.task, head.cell.seed].cells.append(head.cell)
        return self._groups

    def _unusable(self, cell: Cell) -> str:
        """Return why no longer cell can continue a done one, as a clause; empty where one can."""
        if why := why_anew(cell):
            return why
        if not same_versions(self._heads[cell.id].versions):
            return OTHER_VERSIONS
        return "" if name_of(cell) in self._states() else NO_STATE

    def _states(self) -> set[str]:
        if self._here is None:
            self._here = _names(self._folder)
        return self._here

    def _elsewhere_of(self, cell: Cell) -> list[tuple[int, Path]]:
        """Return (episodes, path) of the shorter end states of the cell's lineage in other sweeps."""
        if self._elsewhere is None:
            self._elsewhere = defaultdict(list)
            storage = self._folder.parent.parent
            for folder in storage.glob("*/states") if self._others is not None and is_local(storage) else ():
                for name in _names(folder) if folder != self._folder else ():
                    if (parts := NAME.fullmatch(name)) is not None:
                        self._elsewhere[parts[1]].append((int(parts[2]), folder / name))
        if not self._elsewhere:
            return []
        return [place for place in self._elsewhere.get(cell.lineage, []) if place[0] < cell.episodes]


def _names(folder: Path) -> set[str]:
    """Return the names in a folder; none where the storage does not answer, since no result depends on end states."""
    try:
        return set(sizes(folder))
    except Exception as error:  # each protocol's package raises different errors
        log.warning("cannot list the end states in %s: %s", folder, error)
        return set()


def _but_source(cell: Cell) -> str:
    """Return a hash of all but the episodes and which networks the sources are."""
    values: dict[str, Any] = {name: value for name, value in cell.hyperparameters.items() if name != "episodes"}
    return content_id([values, [[source.task, source.kind] for source in cell.sources]])
