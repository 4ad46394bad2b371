"""A sweep's notes on its custom tasks and agents, with which its results can be read without their code."""

from __future__ import annotations

import logging
from pathlib import Path
from typing import TYPE_CHECKING, Any

from orchestrator.results import checked_json
from search_spaces.search_space import SearchSpace
from trainables.agents.registry import agent_named
from trainables.errors import InputError
from trainables.plugins import names
from trainables.tasks.registry import parse_task
from trainables.tasks.spec.family import TaskFamily

if TYPE_CHECKING:
    from trainables.agents.agent import Agent
from trainables.plugins.notes import remember

FILE = "own.json"

log = logging.getLogger("deltatune.results")


def keep(folder: Path, space: SearchSpace) -> None:
    """Write the notes of every custom task and agent of `space` into the sweep's folder; no file where it has none."""
    tasks = [name for scenario in space.scenarios for name in (*scenario.source.tasks, *scenario.targets)]
    families = {parse_task(name).family.name: parse_task(name).family for name in tasks}
    agents = {name: agent_named(name) for name in (*space.agents, *(s.source.agent for s in space.scenarios))}
    bases = {agent.base: agent_named(agent.base) for agent in agents.values() if agent.base is not None}
    things: dict[str, Any] = {**families, **agents, **bases}
    notes = {name: note(thing) for name, thing in things.items() if thing.origin == "custom"}
    if notes:
        checked_json.write(folder / FILE, {"schema": 1, **_read(folder), **notes}, indent=1)


def recall(folder: Path) -> None:
    """Load the notes of a sweep's folder. They are data: nothing in them is run."""
    remember({name: note for name, note in _read(folder).items() if names.is_custom(name) and isinstance(note, dict)})


def _read(folder: Path) -> dict[str, Any]:
    path = folder / FILE
    try:
        notes = checked_json.read(path)
        if not any(names.is_custom(name) for name in notes):
            raise checked_json.damaged(path, "it holds no notes")
        return notes
    except InputError as error:
        if path.exists():
            log.warning("%s", error)
    return {}


def note(thing: TaskFamily | Agent) -> dict[str, Any]:
    """Return, as plain data, what reading the results of a custom task or agent needs of its code."""
    if isinstance(thing, TaskFamily):
        return {"tabular": thing.model is not None, "defaults": dict(thing.defaults)}
    fields = thing.hyperparameters.model_fields
    defaults = {name: None if field.is_required() else field.default for name, field in fields.items()}
    known = {"base": thing.base, "kind": thing.kind, "description": thing.description, "hyperparameters": defaults}
    return known | {"unwritten": dict(thing.hyperparameters.unwritten)}
