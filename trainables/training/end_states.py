"""The end states of finished cells, from which cells that differ only in having more episodes continue."""

from __future__ import annotations

import logging
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from trainables.agents.registry import agent_named
from trainables.cell import Cell
from trainables.storage.paths import storage_path

FOLDER = "states"
"""The folder of a sweep's end states."""

NAME = re.compile(r"([0-9a-f]{16})-([0-9]+)\.state")
"""The name of an end state: lineage and episodes."""

log = logging.getLogger("deltatune.states")


@dataclass(frozen=True)
class EndStates:
    """Where a stage keeps end states, and those that its cells may continue."""

    folder: str
    most_bytes: int
    """Largest end state that is kept; 0: none."""
    least_seconds: float
    """Shortest cell whose end state is kept: one that is shorter trains anew about as fast."""
    known: Mapping[str, Sequence[tuple[int, str]]] = field(default_factory=dict)
    """Lineage to (episodes, path) of the end states that may be continued."""

    def shorter(self, cell: Cell) -> Path | None:
        """Return the end state of the longest cell that `cell` can continue; None where there is none."""
        if not self.known:
            return None
        episodes = cell.episodes
        found = [(count, path) for count, path in self.known.get(cell.lineage, ()) if count < episodes]
        return storage_path(max(found)[1]) if found else None

    def keep(self, cell: Cell, seconds: float, state: Callable[[], dict[str, Any]]) -> None:
        """Write the end state of a cell that took so many seconds, where it is worth keeping and not too large."""
        if not self.most_bytes or seconds < self.least_seconds or why_anew(cell):
            return
        from trainables.storage import checkpoint  # with numpy: a driver imports this module

        data = checkpoint.packed(state())
        if len(data) > self.most_bytes:
            text = "cell %s: no end state, since its %.3g MB are more than the %.3g MB that --keep-states leaves for it"
            log.info(text, cell.id, len(data) / 1e6, self.most_bytes / 1e6)
            return
        checkpoint.write(storage_path(self.folder) / name_of(cell), data, durable=False)


def name_of(cell: Cell) -> str:
    """Return the name of a cell's end state."""
    return f"{cell.lineage}-{cell.episodes}.state"


def why_anew(cell: Cell) -> str:
    """Return why no longer cell can continue this one, as a clause; empty where one can."""
    settings = cell.settings
    if settings.episodes % settings.evaluate_every:
        return f"{settings.episodes} episodes are no multiple of evaluate_every, {settings.evaluate_every}"
    return agent_named(cell.agent).anew(settings)
