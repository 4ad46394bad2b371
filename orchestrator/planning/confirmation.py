"""Confirmation: the selected configurations run again on seeds that had no part in selecting them."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace

from orchestrator.planning.arms import CONFIRM, Arm, Key, Params, Values
from orchestrator.planning.plan import transfer_arms
from orchestrator.planning.source_choice import Choices, Runs, SourceChoice, SourceRun
from search_spaces.search_space import SearchSpace
from search_spaces.source_space import Scenario
from trainables.errors import InputError
from trainables.tasks.registry import parse_task

CONFIRM_SOURCE = "confirm_source"
"""The stage that trains the unseen seeds' own sources, where the pick gives each seed its own."""

CONFIRMATION = (CONFIRM_SOURCE, CONFIRM)
"""The stages of a confirmation. Their cells have no part in selecting a configuration."""

Chosen = Mapping[Key, Sequence[Values]]
"""Arm to the configurations to confirm: the selected one, and those that a selected one is compared with."""


def check_confirmation(space: SearchSpace, pretrained: Runs) -> None:
    """Raise InputError where an unseen seed would need a pretrained source of its own that was not given."""
    if space.confirm is None:
        return
    for scenario in space.scenarios:
        for task in (parse_task(name).name for name in scenario.source.tasks):
            runs = pretrained.get(task)
            if runs is not None and _own_seed(scenario) and set(space.confirm_seeds) - set(runs):
                raise InputError(
                    f"confirm: the unseen seeds have no pretrained source of their own on {task}: give one --source "
                    "for all seeds, or source.pick best_evaluated"
                )


def confirm_source_arms(space: SearchSpace, choices: Sequence[Choices], pretrained: Runs) -> list[dict[str, Arm]]:
    """Return, by scenario, the arms that train the unseen seeds' own sources with the selected hyperparameters."""
    return [
        {
            task: Arm(scenario.source.agent, task, space.confirm_seeds, (_values(choice),), purpose=CONFIRM)
            for task, choice in by_task.items()
            if _own_seed(scenario) and task not in pretrained and not choice.lost
        }
        for scenario, by_task in zip(space.scenarios, choices, strict=True)
    ]


def with_unseen(
    choices: Sequence[Choices], arms: Sequence[Mapping[str, Arm]], outcome: Callable[[Arm], Mapping[int, SourceRun]]
) -> list[Choices]:
    """Return the outcomes of stage 1 with the unseen seeds' own source runs added; lost where one is missing."""
    return [
        {task: _extended(choice, asked[task], outcome) if task in asked else choice for task, choice in by_task.items()}
        for by_task, asked in zip(choices, arms, strict=True)
    ]


def _extended(choice: SourceChoice, arm: Arm, outcome: Callable[[Arm], Mapping[int, SourceRun]]) -> SourceChoice:
    there = {**_placeholders(arm), **(runs := outcome(arm))}
    missing = [seed for seed in arm.seeds if seed not in runs]
    lost = f"the source of the unseen seed {missing[0]} on {arm.task} has failed" if missing else ""
    return replace(choice, runs={**choice.runs, **there}, lost=lost)


def confirm_arms(space: SearchSpace, choices: Sequence[Choices], params: Params, chosen: Chosen) -> list[Arm]:
    """Return the arms of the transfers that are confirmed: `chosen` configurations on the unseen seeds alone."""
    unseen = space.model_copy(
        update={"seeds": space.confirm_seeds, "scenarios": tuple(_as_trained(space, one) for one in space.scenarios)}
    )
    return [
        replace(arm, grid=tuple(chosen[arm.key]), ranges={}, purpose=CONFIRM)
        for arm in transfer_arms(unseen, choices, params)
        if arm.key in chosen
    ]


def expected_arms(
    space: SearchSpace, choices: Sequence[Choices], transfers: Iterable[Arm], params: Params, pretrained: Runs
) -> tuple[list[dict[str, Arm]], list[Arm]]:
    """Return the arms of both stages as if the first configuration of each arm were selected."""
    sources = confirm_source_arms(space, choices, pretrained)
    firsts = {arm.key: [arm.first()] for arm in transfers if not arm.lost}
    return sources, confirm_arms(space, with_unseen(choices, sources, _placeholders), params, firsts)


def _placeholders(arm: Arm) -> dict[int, SourceRun]:
    """Return source runs that are not there yet, or have failed."""
    return {cell.seed: SourceRun(cell, -math.inf, -math.inf, 0) for cell in arm.all_cells()}


def _own_seed(scenario: Scenario) -> bool:
    return scenario.source.whose == "own_seed" and "learned" in scenario.source.kinds


def _as_trained(space: SearchSpace, scenario: Scenario) -> Scenario:
    """Return the scenario with the seeds of stage 1 said, which are not those of the confirmation."""
    source = scenario.source.model_copy(update={"seeds": space.source_seeds(scenario.source)})
    return scenario.model_copy(update={"source": source})


def _values(choice: SourceChoice) -> Values:
    """Return all hyperparameters of the selected source configuration."""
    return dict(next(iter(choice.runs.values())).cell.hyperparameters)
