"""The transfers of a sweep with `seeds: auto`: which cells run next, and how many there may be."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import TYPE_CHECKING

from orchestrator.planning.arms import Arm, configuration_id
from orchestrator.results.sweep_folder import Results
from search_spaces.search_space import SearchSpace
from trainables.cell import Cell

if TYPE_CHECKING:
    from orchestrator.analysis.contrasts.decisions import Replay


def needed(space: SearchSpace, arms: Iterable[Arm], looks: Mapping[str, int]) -> list[Cell]:
    """Return the cells of the groups of seeds that each configuration needs: the first one where `looks` has none.

    looks: group id of the cells table to how many groups.
    """
    assert space.sequential is not None
    found = []
    for arm in arms:
        for values in arm.grid:
            cells = arm.cells(values)
            seeds = space.seeds[: looks.get(configuration_id(cells[0], arm.label), 1) * space.sequential.group]
            found += [cell for cell in cells if cell.seed in seeds]
    return found


def needed_at_most(space: SearchSpace, arms: Sequence[Arm], tested: Replay | None) -> list[Cell]:
    """Return the cells if every open comparison takes the whole budget. tested: None before the first group."""
    if tested is None:
        return [cell for arm in arms for cell in arm.all_cells()]
    return needed(space, arms, {**tested.looks, **dict.fromkeys(tested.still_open, len(space.seeds))})


def test(space: SearchSpace, results: Results) -> Replay:
    """Return what the sequential test says of the cells that have ended."""
    import pandas as pd

    from orchestrator.analysis.contrasts.decisions import replay

    return replay(space, pd.DataFrame(results.rows()))
