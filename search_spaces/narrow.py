"""Narrowing and overriding a search space from the command line."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Literal

from search_spaces.loading import parse
from search_spaces.search_space import SearchSpace
from trainables.agents.registry import agent_named
from trainables.errors import InputError, unknown
from trainables.plugins.loader import canonicalise
from trainables.tasks.registry import families, parse_task


def narrow(
    space: SearchSpace,
    *,
    tasks: Sequence[str] = (),
    agents: Sequence[str] = (),
    seeds: int | Literal["auto"] | None = None,
    confirm: int | None = None,
    hyperparameters: Mapping[str, Any] | None = None,
) -> SearchSpace:
    """Return the part of `space` with these agents and target tasks: full names, or a family's for all of its targets.

    seeds, confirm and hyperparameters replace those of the space. Raises InputError for an unknown name.
    """
    if not (tasks or agents or hyperparameters) and seeds is None and confirm is None:
        return space
    data: dict[str, Any] = space.to_json()
    tasks, agents = [canonicalise(name) for name in tasks], [canonicalise(name) for name in agents]
    if tasks:
        data["scenarios"] = _with_tasks(data["scenarios"], tasks)
    for name in agents:
        if name not in space.agents:
            raise unknown(f"agent of {space.name}", name, space.agents)
    if agents:
        data["agents"] = {name: options for name, options in data["agents"].items() if name in agents}
    if seeds is not None and not (seeds == "auto" and space.sequential):
        data |= {"seeds": seeds, "sequential": None}
    if confirm is not None:
        data["confirm"] = {"seeds": confirm}
    if not any(agent_named(name).several for name in data["agents"]):
        for scenario in data["scenarios"]:
            scenario["source"]["library"] = []
    _settle(data, hyperparameters or {})
    return parse(space.name, data)


def _settle(data: dict[str, Any], values: Mapping[str, Any]) -> None:
    """Replace every grid that `values` names, and drop shared hyperparameters that no remaining agent has."""
    known = {key for name in data["agents"] for key in agent_named(name).hyperparameters.model_fields}
    shared = {key: option for key, option in data["hyperparameters"].items() if key in known}
    data["hyperparameters"] = shared | {key: {"values": [value]} for key, value in values.items()}
    sources = (scenario["source"]["hyperparameters"] for scenario in data["scenarios"])
    for options in (*data["agents"].values(), *sources):
        for key in values:
            options.pop(key, None)


def _with_tasks(scenarios: list[dict[str, Any]], tasks: Sequence[str]) -> list[dict[str, Any]]:
    wanted = {name if name in families() else parse_task(name).name for name in tasks}
    kept = []
    found: set[str] = set()
    for scenario in scenarios:
        targets = []
        for target in scenario["targets"]:
            task = parse_task(target)
            matched = wanted & {task.name, task.family.name}
            if matched:
                found |= matched
                targets.append(target)
        if targets:
            kept.append({**scenario, "targets": targets})
    if wanted - found:
        there = ", ".join(target for scenario in scenarios for target in scenario["targets"])
        raise InputError(f"'{sorted(wanted - found)[0]}' is not a target task of this search space: there is {there}")
    return kept
