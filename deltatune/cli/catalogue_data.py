"""Tasks and agents as plain data: what `deltatune tasks --json` and `agents --json` print."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from trainables.agents.agent import Agent
    from trainables.tasks.spec.family import Task, TaskFamily, Value


def task_data(family: TaskFamily) -> dict[str, Any]:
    """Return a task family as plain data."""
    return {
        "name": family.name,
        "description": family.description,
        "tabular": family.model is not None,
        "features": [
            {
                "name": feature.name,
                "default": plain(feature.default),
                "description": feature.description,
                "named_values": {name: plain(value) for name, value in feature.named.items()},
            }
            for feature in family.features
        ],
        "paper_targets": list(family.targets),
        "paper_hyperparameters": dict(family.defaults),
    }


def agent_data(agent: Agent) -> dict[str, Any]:
    """Return an agent as plain data."""
    from search_spaces.field_docs import field_docs

    fields, docs = agent.hyperparameters.model_fields, field_docs(agent.hyperparameters)
    return {
        "name": agent.name,
        "description": agent.description,
        "kind": agent.kind,
        "compared_with": agent.base,
        "hyperparameters": [
            {"name": name, "default": field.default, "description": docs.get(name, field.description)}
            for name, field in fields.items()
        ],
    }


def plain(value: Value) -> Any:
    """Return the value of a context feature as JSON has it."""
    return list(value) if isinstance(value, tuple) else value


def set_by_task(task: Task) -> dict[str, dict[str, dict[str, Any]]]:
    """Return, for each agent that can learn the task, what the task sets: {hyperparameter: value and default}."""
    from trainables.agents.registry import agents as registered

    kind = "tabular" if task.tabular else "deep"
    return {name: _set_for(task, agent) for name, agent in registered().items() if agent.kind == kind}


def _set_for(task: Task, agent: Agent) -> dict[str, dict[str, Any]]:
    fields, values = agent.hyperparameters.model_fields, agent.resolve(task, {}).model_dump()
    return {
        key: {"value": value, "default": fields[key].default}
        for key, value in values.items()
        if value != fields[key].default
    }
