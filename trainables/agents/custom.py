"""Custom agents by their canonical names."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

from trainables.errors import InputError
from trainables.plugins import entry_points, loader, names

if TYPE_CHECKING:
    from trainables.agents.agent import Agent


def agent(name: str) -> Agent | None:
    """Return the custom agent called `name`, a placeholder where its code is missing; None where `name` is not custom.

    Raises InputError for a file that is not loaded, and for an object that is no agent.
    """
    from trainables.agents.missing import missing_agent

    if not names.by_file(name):
        short, version = names.package_name(name)
        found = entry_points.find("agent", short)
        if found and (not version or found[0] == name):
            return _agent(*found)
        return missing_agent(name) if version else None
    parts = names.file_name(name)
    if parts.rest:
        raise InputError(f"'{name}' is not an agent's name: an agent has no features after FILE.py:NAME")
    if not parts.pin:
        raise InputError(f"'{name}' names a file that is not loaded: call deltatune.load_custom with this name first")
    thing = loader.attribute(parts)
    return missing_agent(name) if thing is None else _agent(name, thing)


_AGENTS: dict[str, Agent] = {}
"""By canonical name, which identifies the content."""


def _agent(name: str, thing: Any) -> Agent:
    from trainables.agents.agent import Agent

    if name in _AGENTS:
        return _AGENTS[name]
    made = loader.instance(name, thing, Agent, "an agent")
    code, _, _ = name.partition(":")
    short = code.partition("@")[0]
    base = made.base
    if base is not None and names.by_file(name) and base.startswith(f"{short}:"):
        base = f"{code}:{base.partition(':')[2]}"  # another agent of the same file
    return _AGENTS.setdefault(name, replace(made, name=name, base=base, origin="custom"))
