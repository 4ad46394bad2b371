"""Commands that show what there is: tasks, agents, search spaces, and the exact figures of a scenario."""

from __future__ import annotations

import json
from dataclasses import asdict
from pathlib import Path
from typing import Annotated

import typer

from orchestrator.commands.app import Json, app, canonical, out, print_json, print_named


@app.command()
def tasks(as_json: Json = False) -> None:
    """List the tasks and their context features.

    A task is named NAME[:FEATURE=VALUE,...]: `windy_gridworld`, `windy_gridworld:wind=reversed`,
    `supply_chain:demand_mean=5`; 2x means twice the default. Quote names with brackets.
    """
    from orchestrator.present import table, task_data
    from trainables.tasks import all_families

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
    from orchestrator.present import agent_data, table
    from trainables.agents import agents as registered

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
    from orchestrator.present import table
    from search_spaces import built_in, load
    from search_spaces.schema import json_schema

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
    from orchestrator.present import table
    from trainables.delta.bounds import bounds as compute

    data = asdict(compute(canonical(source), canonical(target), gamma))
    if as_json:
        print_json(data)
    else:
        out.print(table(("quantity", "value"), [(key, f"{value}") for key, value in data.items()]))
