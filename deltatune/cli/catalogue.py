"""Commands that show what there is: tasks, agents, search spaces, and the exact figures of a scenario."""

from __future__ import annotations

import json
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from deltatune.cli.app import Json, app, out, print_json, print_named

if TYPE_CHECKING:
    from trainables.agents.agent import Agent
    from trainables.tasks.spec.family import TaskFamily, Value
from deltatune.cli.tables import table


@app.command()
def tasks(as_json: Json = False) -> None:
    """List the tasks and their context features.

    A task is named NAME[:FEATURE=VALUE,...]: `windy_gridworld`, `windy_gridworld:wind=reversed`,
    `supply_chain:demand_mean=5`; 2x means twice the default. Quote names with brackets.
    """
    from trainables.tasks.registry import all_families

    data = [task_data(family) for family in all_families()]
    if as_json:
        print_json(data)
        return
    for family in data:
        print_named(family["name"], family["description"])
        rows = [
            (f["name"], json.dumps(f["default"]), f["description"], ", ".join(f["named_values"]))
            for f in family["features"]
        ]
        out.print(table(("feature", "default", "meaning", "named values"), rows))
        out.print(f"target tasks: {', '.join(family['paper_targets']) or '-'}\n")


@app.command()
def agents(as_json: Json = False) -> None:
    """List the agents and their hyperparameters."""
    from trainables.agents.registry import agents as registered

    data = [agent_data(agent) for agent in registered().values()]
    if as_json:
        print_json(data)
        return
    for agent in data:
        print_named(agent["name"], agent["description"])
        rows = [(h["name"], str(h["default"]), h["description"] or "") for h in agent["hyperparameters"]]
        out.print(table(("hyperparameter", "default", "meaning"), rows))


@app.command()
def spaces(
    name: Annotated[str | None, typer.Argument(help="Show this one's YAML, to start your own from.")] = None,
    schema: Annotated[
        bool, typer.Option("--schema", help="Print the JSON Schema of search spaces, for editors.")
    ] = False,
    as_json: Json = False,
) -> None:
    """List the built-in search spaces, or show one: `deltatune spaces demo > mine.yaml`."""
    from search_spaces.json_schema import json_schema
    from search_spaces.loading import built_in, load

    if schema:
        print_json(json_schema())
        return

    if name is not None:
        space = load(name)
        if as_json:
            print_json(space.to_json())
        else:
            typer.echo(built_in().get(name, Path(name)).read_text(), nl=False)
        return
    found = [load(each) for each in built_in()]
    if as_json:
        print_json([space.to_json() for space in found])
    else:
        out.print(table(("name", "what it asks"), [(space.name, space.description) for space in found]))


@app.command()
def bounds(
    source: Annotated[str, typer.Argument(help="Source task, e.g. windy_gridworld.")],
    target: Annotated[str, typer.Argument(help="Target task, e.g. windy_gridworld:wind=reversed.")],
    gamma: Annotated[float, typer.Option(help="Discount factor, in [0, 1).")] = 0.99,
    as_json: Json = False,
) -> None:
    """Compute the exact delta between two tabular tasks, and check Theorems 1 and 3 on them."""
    from trainables.delta.bounds import bounds as compute
    from trainables.plugins.loader import canonicalise

    data = asdict(compute(canonicalise(source), canonicalise(target), gamma))
    if as_json:
        print_json(data)
    else:
        out.print(table(("quantity", "value"), [(key, f"{value}") for key, value in data.items()]))


def task_data(family: TaskFamily) -> dict[str, Any]:
    """A task family as plain data."""
    return {
        "name": family.name,
        "description": family.description,
        "tabular": family.model is not None,
        "features": [
            {
                "name": feature.name,
                "default": _json(feature.default),
                "description": feature.description,
                "named_values": {name: _json(value) for name, value in feature.named.items()},
            }
            for feature in family.features
        ],
        "paper_targets": list(family.targets),
        "paper_hyperparameters": dict(family.defaults),
    }


def agent_data(agent: Agent) -> dict[str, Any]:
    """An agent as plain data."""
    fields = agent.hyperparameters.model_fields
    return {
        "name": agent.name,
        "description": agent.description,
        "kind": agent.kind,
        "compared_with": agent.base,
        "hyperparameters": [
            {"name": name, "default": field.default, "description": field.description} for name, field in fields.items()
        ],
    }


def _json(value: Value) -> Any:
    return list(value) if isinstance(value, tuple) else value
