"""The extras that a search space needs, checked before any work."""

from __future__ import annotations

from search_spaces.search_space import SearchSpace
from trainables.agents.registry import agent_named
from trainables.extras import require
from trainables.tasks.registry import parse_task


def require_extras(space: SearchSpace) -> None:
    """Raise InputError, with what to install, where a task or an agent of `space` lacks its library."""
    sources = [scenario.source for scenario in space.scenarios]
    tasks = [task for scenario in space.scenarios for task in (*scenario.source.tasks, *scenario.targets)]
    agents = [*(source.agent for source in sources if "learned" in source.kinds), *space.agents]
    needs = {name: agent_named(name).extra for name in agents}
    require(needs | {task.family.name: task.family.extra for task in map(parse_task, tasks)})
