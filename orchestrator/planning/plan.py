"""From a search space to the arms of each stage: the source tasks first, then the transfers."""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Literal

from orchestrator.planning.arms import Arm, Params, Sources, Values, distinct, entry_of
from orchestrator.planning.source_choice import Choices, SourceChoice, SourceRun
from search_spaces.domains import Grid, Range
from search_spaces.search_space import SearchSpace
from search_spaces.source_space import Scenario, SourceSpace
from trainables.agents.registry import agent_named
from trainables.cell import Source
from trainables.errors import InputError
from trainables.tasks.registry import parse_task
from trainables.tasks.spec.family import Task

SOURCE, TRANSFER = "source", "transfer"
"""The stages."""

NOTHING = SourceChoice({}, {})


def source_arms(space: SearchSpace, params: Params) -> list[dict[str, Arm]]:
    """Return stage 1 of each scenario: source task to its arm, where stage 1 trains or selects anything.

    The tasks of a library are trained like the scenario's source task.
    """
    return [{arm.task: arm for arm in _sources_of(space, scenario.source, params)} for scenario in space.scenarios]


def _sources_of(space: SearchSpace, source: SourceSpace, params: Params) -> list[Arm]:
    learned = "learned" in source.kinds
    if not source.hyperparameters and not learned:
        return []
    tasks = source.tasks if learned else source.tasks[:1]
    arms = [Arm(source.agent, parse_task(task).name, space.source_seeds(source)) for task in tasks]
    return [_configured(arm, space, source.hyperparameters, {}, params) for arm in arms]


def transfer_arms(space: SearchSpace, choices: Sequence[Choices], params: Params) -> list[Arm]:
    """Return stage 2: agents x targets x kinds of source, given each scenario's outcome of stage 1.

    A baseline without transfer has the hyperparameters that stage 1 settled for the scenario's source.
    """
    return distinct(
        _transfer(space, scenario, choice, params, agent, target, kind)
        for scenario, choice in zip(space.scenarios, choices, strict=True)
        for target, agent in itertools.product(scenario.targets, space.agents)
        for kind in (scenario.source.kinds if agent_named(agent).needs_source else ("none",))
    )


def _transfer(
    space: SearchSpace, scenario: Scenario, choices: Choices, params: Params, agent: str, target: str, kind: str
) -> Arm:
    source, target = scenario.source, parse_task(target).name
    first, *others = (parse_task(name).name for name in source.tasks)
    tasks = [first, *(name for name in others if name != target)] if agent_named(agent).several else [first]
    of_first = choices.get(first, NOTHING)
    used = [of_first, *(choices.get(task, NOTHING) for task in tasks if kind == "learned")]
    lost = next((choice.lost for choice in used if choice.lost), "")
    if kind == "none":
        arm = Arm(agent, target, space.seeds, baseline_for=first, lost=lost)
    else:
        pick = source.whose if kind == "learned" else ""
        sources = _sources(tasks, target, kind, pick, choices, space.seeds, space.source_seeds(source))
        arm = Arm(agent, target, space.seeds, sources=sources, pick=pick, lost=lost)
    return _configured(arm, space, space.agents[agent], of_first.values, params)


def _configured(
    arm: Arm, space: SearchSpace, options: Mapping[str, Grid | Range], inherited: Values, params: Params
) -> Arm:
    """Return the arm with its grid. Precedence: `params`, the agent's options, the space's, what stage 1 settled."""
    agent = agent_named(arm.agent)
    if (entry := entry_of(params, arm.key)) is not None:
        agent.resolve(parse_task(arm.task), params[entry])
        return replace(arm, grid=(params[entry],))
    known = agent.hyperparameters.model_fields
    options = {name: option for name, option in {**space.hyperparameters, **options}.items() if name in known}
    fixed = {name: value for name, value in inherited.items() if name in known and name not in options}
    grids = {name: option.values for name, option in options.items() if isinstance(option, Grid)}
    ranges = {name: option for name, option in options.items() if isinstance(option, Range)}
    grid = tuple(fixed | dict(zip(grids, chosen, strict=True)) for chosen in itertools.product(*grids.values()))
    return replace(arm, grid=grid, ranges=ranges)


def _sources(
    tasks: Sequence[str],
    target: str,
    kind: str,
    pick: str,
    choices: Choices,
    seeds: Sequence[int],
    trained: Sequence[int],
) -> dict[int, tuple[Sources, ...]]:
    """Return seed to the sources of each of its cells. trained: the seeds of stage 1, which must all be there."""
    picks, own = [pick], trained
    if pick == "each":
        picks, own = _networks(tasks, choices), ()

    def of(task: str, one: str) -> str:
        return str(choices.get(task, NOTHING).seed_for(target)) if one == "ranked" else one

    crossed = [[_column(task, kind, of(task, one), choices, seeds, own) for task in tasks] for one in picks]
    return {seed: tuple(tuple(column[seed] for column in columns) for columns in crossed) for seed in seeds}


def _networks(tasks: Sequence[str], choices: Choices) -> list[str]:
    """Return the source seeds that differ in what they know; a pretrained source may serve several seeds."""
    runs = [choices.get(task, NOTHING).runs for task in tasks]
    shared = [seed for seed in runs[0] if all(seed in others for others in runs)]
    if not shared:
        raise InputError(f"the source {tasks[0]} has no trained cell for seed 0")
    first = {tuple(one[seed].cell.id for one in runs): str(seed) for seed in reversed(shared)}
    return list(reversed(first.values()))


def _column(
    name: str, kind: str, pick: str, choices: Choices, seeds: Sequence[int], own: Sequence[int]
) -> dict[int, Source]:
    """Return seed to what is known of the source task `name`.

    own: the seeds whose T, the steps of C (eq. 6), is that of their own source run; else it is the source network's.
    """
    task = parse_task(name)
    if kind == "exact":
        return {seed: Source(task=task.name, kind="exact") for seed in seeds}
    choice = choices.get(name, NOTHING)
    needed = [seed for seed in seeds if pick == "own_seed" or seed in own]
    needed += [int(pick)] if pick.isdigit() else []
    missing = [seed for seed in needed if seed not in choice.runs]
    if missing:
        raise InputError(f"the source {task.name} has no trained cell for seed {missing[0]}")
    if pick == "own_seed":
        return {seed: _learned(task, choice.runs[seed], "last", choice.runs[seed]) for seed in seeds}
    model = choice.runs[choice.best_seed() if pick == "best_evaluated" else int(pick)]
    checkpoint: Literal["last", "best"] = "last" if task.tabular else "best"
    return {seed: _learned(task, model, checkpoint, choice.runs[seed] if seed in own else model) for seed in seeds}


def _learned(task: Task, model: SourceRun, checkpoint: Literal["last", "best"], timed: SourceRun) -> Source:
    """Return the knowledge of `model`; T, the steps of C (eq. 6), is that of the source run `timed`."""
    steps = None if task.tabular else timed.steps
    return Source(task=task.name, kind="learned", cell_id=model.cell.id, checkpoint=checkpoint, steps=steps)
