"""Which entries of an exported file of hyperparameters apply to a search space."""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Iterator

from orchestrator.planning.arms import Key, Params, entry_of
from search_spaces.search_space import SearchSpace
from trainables.agents.registry import agent_named
from trainables.errors import InputError
from trainables.plugins.names import short
from trainables.tasks.registry import parse_task

MAX_NAMED = 3
"""Entries that a message names."""


def check_params(file: str, params: Params, space: SearchSpace) -> str:
    """Return a sentence on how many entries of a file apply, or '' where all do. Raises InputError where none does."""
    wanted = list(dict.fromkeys(keys(space)))
    used = {entry_of(params, key) for key in wanted}
    unused = [entry for entry in params if entry not in used]
    count = f"{file}: {len(params) - len(unused)} of {len(params)} entries apply"
    if params and len(unused) == len(params):
        raise InputError(f"{count}: it has {_named(unused)}; {space.name} needs {_named(wanted)}")
    return f"{count}; not {_named(unused)}" if unused else ""


def keys(space: SearchSpace) -> Iterator[Key]:
    """Yield the keys of both stages' arms, in their order."""
    for scenario in space.scenarios:
        for task in scenario.source.tasks:
            yield Key(parse_task(task).name, scenario.source.agent)
    for scenario in space.scenarios:
        source = scenario.source
        first = parse_task(source.task).name
        for target, agent in itertools.product(scenario.targets, space.agents):
            task = parse_task(target).name
            for kind in source.kinds if agent_named(agent).needs_source else ("none",):
                yield Key(task, agent, first, kind, source.whose if kind == "learned" else "")


def _named(entries: Iterable[Key]) -> str:
    """Return 'delta_gate on cartpole (learned), ... and 3 more'."""
    names = list(
        dict.fromkeys(
            f"{short(key.agent)} on {short(key.task)}" + (f" ({key.kind})" if key.kind != "none" else "")
            for key in entries
        )
    )
    more = f" and {len(names) - MAX_NAMED} more" if len(names) > MAX_NAMED else ""
    return ", ".join(names[:MAX_NAMED]) + more
