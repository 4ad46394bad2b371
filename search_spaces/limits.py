"""How large a search space may be: beyond these numbers a mistake is likelier than a wish."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping
from math import prod
from typing import TYPE_CHECKING

from search_spaces.domains import Grid, Range
from trainables.agents.registry import agent_named

if TYPE_CHECKING:
    from search_spaces.search_space import SearchSpace

MOST_CELLS = 1_000_000
"""Cells that a search space may make."""

MOST_CONFIGURATIONS = 10_000
"""Configurations of one task, agent and source: what a grid multiplies to, or a search's budget."""

MOST_SEEDS = 10_000
MOST_TARGETS = 1_000
"""Target tasks of a scenario."""

MOST_SCENARIOS = 100
MOST_LIBRARY = 100
"""Source tasks of a library."""

LARGEST_SEED = 2**63 - 1
"""What a column of whole numbers holds."""

Hyperparameters = Mapping[str, Grid | Range]


def check_size(space: SearchSpace) -> None:
    """Raise ValueError where a search space would make too many configurations or cells. Makes none of them."""
    asked = 0
    for scenario in space.scenarios:
        source, seeds = scenario.source, len(space.seeds)
        if source.hyperparameters or "learned" in source.kinds:
            tasks = len(source.tasks) if "learned" in source.kinds else 1
            asked += tasks * seeds * _configurations(space, source.agent, source.hyperparameters)
        for agent, options in space.agents.items():
            kinds = len(source.kinds) if agent_named(agent).needs_source else 1
            asked += len(scenario.targets) * kinds * seeds * _configurations(space, agent, options)
    if asked > MOST_CELLS:
        raise ValueError(f"it asks for {asked:,} cells, more than {MOST_CELLS:,}: take fewer values, tasks or seeds")


def _configurations(space: SearchSpace, agent: str, own: Hyperparameters) -> int:
    known = agent_named(agent).hyperparameters.model_fields
    options = [option for name, option in {**space.hyperparameters, **own}.items() if name in known]
    count = prod(len(option.values) for option in options if isinstance(option, Grid))
    if count > MOST_CONFIGURATIONS:
        raise ValueError(
            f"the grid of {agent} has {count:,} configurations, more than {MOST_CONFIGURATIONS:,}: take fewer values, "
            "or search: {method: random}"
        )
    return space.search.budget if any(isinstance(option, Range) for option in options) else count


def twice(names: Iterable[str]) -> list[str]:
    """Return the names that are there more than once, in order."""
    return sorted(name for name, count in Counter(names).items() if count > 1)
