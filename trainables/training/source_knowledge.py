"""The knowledge of a cell's sources. Light to import, where no source is exact."""

from __future__ import annotations

from collections.abc import Callable

from trainables.cell import Cell
from trainables.knowledge import Knowledge, joined
from trainables.tasks.registry import parse_task


def source_knowledge(cell: Cell, load: Callable[[str], Knowledge]) -> Knowledge:
    """Return the joined knowledge of the sources of `cell`: learned ones by `load(cell_id)`, exact ones computed."""
    return joined(
        [
            load(str(source.cell_id))
            if source.kind == "learned"
            else exact_source(source.task, float(cell.hyperparameters["gamma"]))
            for source in cell.sources
        ]
    )


def exact_source(task: str, gamma: float) -> Knowledge:
    """Return Q* of `task`, by value iteration, as source knowledge."""
    from trainables.delta.exact import exact_q

    return Knowledge({"q": exact_q(parse_task(task).name, gamma)})
