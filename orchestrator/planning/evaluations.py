"""The number of evaluations of which an AUC is the mean, and a warning where it is small."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Mapping
from typing import Any

from search_spaces.domains import Grid, Range
from search_spaces.search_space import SearchSpace
from trainables.agents.registry import agent_named
from trainables.tasks.registry import parse_task

FEW_EVALUATIONS = 5
"""Evaluations below which the mean of a curve is a poor estimate."""


def few_evaluations(hyperparameters: Mapping[str, Any]) -> str | None:
    """Return a warning where a cell has fewer than FEW_EVALUATIONS evaluations, or None."""
    episodes, every = hyperparameters.get("episodes"), hyperparameters.get("evaluate_every")
    if not isinstance(episodes, int) or not isinstance(every, int) or every < 1:
        return None
    count = 1 + math.ceil(episodes / every)
    if count >= FEW_EVALUATIONS:
        return None
    wanted = max(episodes // (FEW_EVALUATIONS - 1), 1)
    return (
        f"episodes={episodes} with evaluate_every={every} leaves {count} evaluations, one of them before training, "
        f"of which the AUC is the mean: --set evaluate_every={wanted}"
    )


def few_evaluations_in(space: SearchSpace) -> str | None:
    """Return the first warning of `few_evaluations` over a search space, or None."""
    return next(filter(None, map(few_evaluations, _trainings(space))), None)


def _trainings(space: SearchSpace) -> Iterator[dict[str, Any]]:
    """Yield the length and evaluation interval of every agent's training on every task, transfers first."""
    stages = [
        (agent, own, target) for s in space.scenarios for target in s.targets for agent, own in space.agents.items()
    ]
    stages += [
        (s.source.agent, s.source.hyperparameters, task)
        for s in space.scenarios
        if "learned" in s.source.kinds
        for task in s.source.tasks
    ]
    for agent, own, task in stages:
        named, options = agent_named(agent), {**space.hyperparameters, **own}
        swept = {name: _values(options[name]) for name in ("episodes", "evaluate_every") if name in options}
        for values in itertools.product(*swept.values()):
            yield named.resolve(parse_task(task), dict(zip(swept, values, strict=True))).model_dump()


def _values(option: Grid | Range) -> tuple[Any, ...]:
    return tuple(option.values) if isinstance(option, Grid) else tuple(option.ends())
