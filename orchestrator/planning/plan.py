"""From a search space to the cells of each stage: the source tasks first, then the transfers."""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from typing import Literal

from orchestrator.planning.arms import Key, Pair, Params, Values
from orchestrator.planning.source_choice import SourceChoice, SourceRun
from search_spaces.domains import Grid, Range
from search_spaces.search_space import Scenario, SearchSpace, SourceSpace
from trainables.agents.registry import agent_named
from trainables.cell import Source
from trainables.errors import InputError
from trainables.tasks.registry import parse_task
from trainables.tasks.spec.family import Task


def source_pairs(space: SearchSpace, params: Params) -> list[Pair | None]:
    """Stage 1 of each scenario: the source's agent on the source task; None where nothing is learned or chosen."""
    return [_source_pair(space, scenario, scenario.source.task, params) for scenario in space.scenarios]


def library_pairs(space: SearchSpace, params: Params) -> list[list[Pair | None]]:
    """Stage 1 of each scenario's library: the same as `source_pairs` on each of its further source tasks."""
    return [
        [_source_pair(space, scenario, task, params) for task in scenario.source.library]
        for scenario in space.scenarios
    ]


def transfer_pairs(space: SearchSpace, choices: Sequence[SourceChoice], params: Params) -> list[Pair]:
    """Stage 2: agents x targets x kinds of source, given each scenario's outcome of stage 1."""
    pairs: dict[tuple[Key, str], Pair] = {}
    for scenario, choice in zip(space.scenarios, choices, strict=True):
        for target, agent in itertools.product(scenario.targets, space.agents):
            kinds = scenario.source.kinds if agent_named(agent).needs_source else (None,)
            for kind in kinds:
                sources = _sources(scenario.source, scenario.source.task, kind, choice, space.seeds)
                pair = _pair(space, agent, target, dict(space.agents[agent]), choice.values, params, sources)
                if agent_named(agent).several:
                    pair = replace(pair, libraries=_libraries(scenario.source, target, kind, choice, space.seeds))
                pairs.setdefault((pair.key, scenario.source.task if sources else ""), pair)
    return list(pairs.values())


def _libraries(
    source: SourceSpace, target: str, kind: str | None, choice: SourceChoice, seeds: Sequence[int]
) -> dict[int, tuple[Source, ...]]:
    """Seed to the sources of the library, without the target itself."""
    own = parse_task(target).name
    others = choice.library or (SourceChoice({}, {}),) * len(source.library)
    columns = [
        _sources(source, task, kind, other, seeds)
        for task, other in zip(source.library, others, strict=True)
        if parse_task(task).name != own
    ]
    return {seed: tuple(column[seed] for column in columns) for seed in seeds}


def _source_pair(space: SearchSpace, scenario: Scenario, task: str, params: Params) -> Pair | None:
    source = scenario.source
    if not source.hyperparameters and "learned" not in source.kinds:
        return None
    return _pair(space, source.agent, task, dict(source.hyperparameters), {}, params, {})


def _pair(
    space: SearchSpace,
    agent: str,
    task: str,
    own: Mapping[str, Grid | Range],
    inherited: Values,
    params: Params,
    sources: Mapping[int, Source],
) -> Pair:
    """The agent's own options over the space's over what stage 1 settled; `params` over all of them."""
    task = parse_task(task).name
    known = agent_named(agent).hyperparameters.model_fields
    options = {key: option for key, option in {**space.hyperparameters, **own}.items() if key in known}
    fixed = {key: value for key, value in inherited.items() if key in known and key not in options}
    kind = next(iter(sources.values())).kind if sources else "none"
    if (task, agent, kind) in params:
        settled = params[task, agent, kind]
        agent_named(agent).resolve(parse_task(task), settled)
        return Pair(agent, task, space.seeds, (settled,), {}, sources)
    grids = {key: option.values for key, option in options.items() if isinstance(option, Grid)}
    ranges = {key: option for key, option in options.items() if isinstance(option, Range)}
    grid = tuple(fixed | dict(zip(grids, values, strict=True)) for values in itertools.product(*grids.values()))
    return Pair(agent, task, space.seeds, grid, ranges, sources)


def _sources(
    source: SourceSpace, name: str, kind: str | None, choice: SourceChoice, seeds: Iterable[int]
) -> dict[int, Source]:
    """Seed to what is known of the source task `name`."""
    task = parse_task(name)
    if kind is None:
        return {}
    if kind == "exact":
        return {seed: Source(task=task.name, kind="exact") for seed in seeds}
    missing = [seed for seed in seeds if seed not in choice.runs]
    if missing:
        raise InputError(f"the source {task.name} has no trained cell for seed {missing[0]}")
    pick = source.pick
    if pick is None:
        pick = "own_seed" if task.tabular else "best_evaluated"
    if pick == "own_seed":
        return {seed: _learned(task, choice.runs[seed], "last", choice.runs[seed]) for seed in seeds}
    giver = choice.runs[choice.best_seed() if pick == "best_evaluated" else int(pick)]
    return {seed: _learned(task, giver, "last" if task.tabular else "best", choice.runs[seed]) for seed in seeds}


def _learned(task: Task, giver: SourceRun, checkpoint: Literal["last", "best"], own: SourceRun) -> Source:
    """The knowledge of `giver`; T, the steps of C (eq. 6), is that of the target seed's own source run."""
    steps = None if task.tabular else own.steps
    return Source(task=task.name, kind="learned", cell_id=giver.cell.id, checkpoint=checkpoint, steps=steps)


SOURCE, TRANSFER = "source", "transfer"
"""The stages."""
