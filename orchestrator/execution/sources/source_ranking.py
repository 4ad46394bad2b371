"""Ranking the source networks of a scenario on each target (source.pick ranked), between the two stages."""

from __future__ import annotations

import logging
from collections.abc import Mapping, Sequence
from dataclasses import replace

from orchestrator.planning.source_choice import Choices, SourceChoice
from orchestrator.results import checked_json
from orchestrator.results.sweep_folder import Results
from orchestrator.sources.library import SourceLibrary
from search_spaces.search_space import SearchSpace
from trainables.errors import InputError
from trainables.plugins.loader import describe_error
from trainables.tasks.registry import parse_task

FILE = "source_ranking.json"
"""Target task to source cell to |delta|: what was ranked once stays, whatever a custom task does the next time."""

EPISODES = 20
"""Episodes of the target that every network plays."""

SEED = 0
"""Of these episodes: all networks see the same random numbers, and a resumed sweep the same ranking."""

Sizes = dict[str, dict[str, float]]

log = logging.getLogger("deltatune.sweep")


def ranked(space: SearchSpace, choices: Sequence[Choices], results: Results, writes: bool = True) -> list[Choices]:
    """Return the outcomes of stage 1 with the seed that is ranked first on every target, where the pick asks for it.

    A network that is not in the library yet leaves its task unranked. A target that cannot be played loses the source.
    writes: whether to keep the sizes of delta in the sweep's folder.
    """
    asked = [scenario.source.whose == "ranked" and "learned" in scenario.source.kinds for scenario in space.scenarios]
    if not any(asked):
        return list(choices)
    known = _read(results)
    before = {target: dict(sizes) for target, sizes in known.items()}
    library = SourceLibrary(results.storage)
    found = [
        {task: _ranked(choice, scenario.targets, library, known) for task, choice in by_task.items()}
        if wanted
        else by_task
        for scenario, by_task, wanted in zip(space.scenarios, choices, asked, strict=True)
    ]
    if writes and known != before:
        checked_json.write(results.folder / FILE, {"schema": 1, "episodes": EPISODES, "delta": known}, indent=1)
    return found


def _ranked(choice: SourceChoice, targets: Sequence[str], library: SourceLibrary, known: Sizes) -> SourceChoice:
    cells = tuple(dict.fromkeys(run.cell.id for run in choice.runs.values()))
    if choice.lost or not all(map(library.has, cells)):
        return choice
    first: dict[str, int] = {}
    for target in (parse_task(name).name for name in targets):
        try:
            sizes = _sizes(target, cells, library, known)
        except Exception as error:
            log.exception("the source networks cannot be ranked on %s", target)
            return replace(choice, lost=f"the source networks cannot be ranked on {target}: {describe_error(error)}")
        first[target] = min(choice.runs, key=lambda seed: (sizes[choice.runs[seed].cell.id], seed))
    return replace(choice, ranked=first)


def _sizes(target: str, cells: Sequence[str], library: SourceLibrary, known: Sizes) -> Mapping[str, float]:
    """Return source cell to |delta| on a target, measured where it is not known."""
    sizes = known.get(target, {})
    missing = [cell for cell in cells if cell not in sizes]
    if missing:
        from orchestrator.sources.ranking import own_path_delta  # compiled kernels

        entries = [library.entry(cell) for cell in missing]
        sizes = sizes | dict(zip(missing, own_path_delta(target, entries, EPISODES, SEED), strict=True))
        known[target] = sizes
        log.info("|delta| of the source networks on %s: %s", target, {cell: f"{sizes[cell]:.3g}" for cell in cells})
    return sizes


def _read(results: Results) -> Sizes:
    """Return the sizes that are known; none where the file is missing or damaged: they are measured again."""
    path = results.folder / FILE
    try:
        data = checked_json.read(path) if path.exists() else {}
    except InputError as error:
        log.warning("%s: the source networks are ranked again", error)
        return {}
    found: dict[str, dict[str, float]] = data.get("delta", {})
    return {target: dict(sizes) for target, sizes in found.items()}
