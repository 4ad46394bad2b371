"""The extras and the custom code that a search space needs, checked before any work."""

from __future__ import annotations

from search_spaces.search_space import SearchSpace
from trainables.agents.agent import Agent
from trainables.agents.registry import agent_named
from trainables.errors import InputError
from trainables.extras import require
from trainables.plugins.notes import needed_code
from trainables.tasks.registry import parse_task
from trainables.tasks.spec.family import TaskFamily


def require_runnable(space: SearchSpace) -> None:
    """Raise InputError where a task or an agent of `space` lacks its library or its file, with what to do.

    Only custom code of a recorded search space lacks its file: a name in a record never loads one.
    """
    sources = [scenario.source for scenario in space.scenarios]
    names = [*(source.agent for source in sources if "learned" in source.kinds), *space.agents]
    tasks = [task for scenario in space.scenarios for task in (*scenario.source.tasks, *scenario.targets)]
    things: list[tuple[str, Agent | TaskFamily]] = [
        *(("agent", agent_named(name)) for name in names),
        *(("task", parse_task(task).family) for task in tasks),
    ]
    for kind, thing in things:
        if thing.origin == "missing":
            raise InputError(needed_code(kind, thing.name))
    require({thing.name: thing.extra for _, thing in things})
