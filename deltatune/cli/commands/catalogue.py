"""Commands that list tasks, agents and search spaces, and compute the exact delta between two tasks."""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from deltatune.cli.app import CATALOGUE_PANEL, Json, app, out, print_json, print_named, program
from deltatune.cli.catalogue_data import agent_data, plain, set_by_task, task_data
from deltatune.cli.sheet import table

if TYPE_CHECKING:
    from trainables.agents.agent import Agent
    from trainables.delta.bounds import Bounds
    from trainables.tasks.spec.family import TaskFamily


@app.command(rich_help_panel=CATALOGUE_PANEL)
def tasks(
    name: Annotated[
        str | None,
        typer.Argument(metavar="[TASK]", help="Show this one, with the hyperparameters that agents use on it."),
    ] = None,
    as_json: Json = False,
) -> None:
    """List the tasks and their context features, or show one.

    A task is named NAME[:FEATURE=VALUE,...]: `windy_gridworld`, `windy_gridworld:wind=reversed`,
    `supply_chain:demand_mean=5`; 2x means twice the default. Quote names with brackets.
    """
    from trainables.plugins.loader import canonicalise
    from trainables.tasks.registry import all_families, parse_task

    if name is not None:
        task = parse_task(canonicalise(name))
        used = set_by_task(task)
        if as_json:
            context = {key: plain(value) for key, value in task.context.items()}
            print_json(task_data(task.family) | {"context": context, "used": used})
            return
        _print_task(task_data(task.family))
        alike: dict[tuple[str, str], list[str]] = {}
        for agent, values in used.items():
            alike.setdefault(_texts(values), []).append(agent)
        rows = [(", ".join(agents), *texts) for texts, agents in alike.items()]
        out.print(table(("agents", "hyperparameters that this task sets", "the agents' defaults"), rows))
        return
    data = [task_data(family) for family in all_families()]
    if as_json:
        print_json(data)
        return
    for family in data:
        _print_task(family)


def _print_task(family: Mapping[str, Any]) -> None:
    print_named(family["name"], family["description"])
    rows = [
        (f["name"], json.dumps(f["default"]), f["description"], ", ".join(f["named_values"]))
        for f in family["features"]
    ]
    out.print(table(("feature", "default", "meaning", "named values"), rows))
    out.print(f"target tasks: {', '.join(family['paper_targets']) or '-'}\n", soft_wrap=True)


def _texts(values: Mapping[str, Mapping[str, Any]]) -> tuple[str, str]:
    """Return the values and the defaults that they replace, as 'name=value, ...'."""
    sides = (", ".join(f"{name}={pair[side]}" for name, pair in values.items()) for side in ("value", "default"))
    first, second = sides
    return first or "-", second or "-"


@app.command(rich_help_panel=CATALOGUE_PANEL)
def agents(
    name: Annotated[
        str | None, typer.Argument(metavar="[AGENT]", help="Show this agent with its hyperparameters on each task.")
    ] = None,
    as_json: Json = False,
) -> None:
    """List the agents, or show one with its hyperparameters and their values on each task."""
    from trainables.agents.registry import agent_named
    from trainables.agents.registry import agents as registered
    from trainables.plugins.loader import canonicalise

    if name is not None:
        _show_agent(agent_named(canonicalise(name)), as_json)
        return
    found = registered().values()
    if as_json:
        print_json([agent_data(agent) for agent in found])
        return
    rows = [(agent.name, agent.kind, agent.base or "-", agent.description) for agent in found]
    out.print(table(("agent", "kind", "compared with", "what it does"), rows))
    out.print(f"Hyperparameters and their values: {program()} agents NAME", soft_wrap=True)


def _show_agent(agent: Agent, as_json: bool) -> None:
    from trainables.tasks.registry import all_families

    data = agent_data(agent)
    families = [family for family in all_families() if (family.model is not None) == (agent.kind == "tabular")]
    by_task = {family.name: _values(agent, family) for family in families}
    if as_json:
        print_json(data | {"values": by_task})
        return
    print_named(data["name"], data["description"])
    if data["compared_with"]:
        out.print(f"It is compared with {data['compared_with']}, which trains its source.", soft_wrap=True)
    rows = [
        (h["name"], str(h["default"]) or "-", _exceptions(h, by_task), h["description"] or "")
        for h in data["hyperparameters"]
    ]
    out.print(table(("hyperparameter", "default", "on the tasks", "meaning"), rows))


def _values(agent: Agent, family: TaskFamily) -> dict[str, Any]:
    from trainables.tasks.spec.family import Task

    return agent.resolve(Task(family), {}).model_dump()


def _exceptions(hyperparameter: Mapping[str, Any], by_task: Mapping[str, Mapping[str, Any]]) -> str:
    """Return the tasks that set a value other than the default: '5000 in windy_gridworld'."""
    name, default = hyperparameter["name"], hyperparameter["default"]
    there = ((task, values.get(name)) for task, values in by_task.items())
    return ", ".join(f"{value} in {task}" for task, value in there if value != default) or "-"


@app.command(rich_help_panel=CATALOGUE_PANEL)
def spaces(
    name: Annotated[
        str | None, typer.Argument(metavar="[SPACE]", help="Print the YAML of this one, as a start for another.")
    ] = None,
    schema: Annotated[
        bool, typer.Option("--schema", help="Print the JSON Schema of search spaces, for editors.")
    ] = False,
    as_json: Json = False,
) -> None:
    """List the built-in search spaces, or show one: `deltatune spaces demo > mine.yaml`."""
    from search_spaces.loading import built_in, load, read_yaml

    if schema:
        from search_spaces.json_schema import json_schema

        print_json(json_schema())
        return

    if name is not None:
        space = load(name)
        if as_json:
            print_json(space.to_json())
        else:
            typer.echo(built_in().get(name, Path(name)).read_text(), nl=False)
        return
    if as_json:
        print_json([load(each).to_json() for each in built_in()])
        return
    texts = [read_yaml(path) for path in built_in().values()]
    out.print(table(("name", "description"), [(text["name"], text["description"]) for text in texts]))


@app.command(rich_help_panel=CATALOGUE_PANEL)
def bounds(
    source: Annotated[str, typer.Argument(metavar="SOURCE", help="The source task, such as windy_gridworld.")],
    target: Annotated[
        str, typer.Argument(metavar="TARGET", help="The target task, such as windy_gridworld:wind=reversed.")
    ],
    gamma: Annotated[float, typer.Option(metavar="GAMMA", help="The discount factor, in [0, 1).")] = 0.99,
    as_json: Json = False,
) -> None:
    """Compute the exact delta between two tabular tasks, and check Theorems 1 and 3 on them."""
    from trainables.delta.bounds import bounds as compute
    from trainables.plugins.loader import canonicalise

    found = compute(canonicalise(source), canonicalise(target), gamma)
    if as_json:
        print_json(asdict(found))
        return
    for sentence in bounds_sentences(found):
        out.print(sentence, soft_wrap=True)


def bounds_sentences(found: Bounds) -> Iterable[str]:
    """Yield the exact results for a scenario, one sentence each."""
    holds = {True: "holds", False: "does NOT hold"}
    yield f"From {found.source} to {found.target}, discounted by {found.gamma:g}:"
    yield f"- The largest |delta| over all states and actions is {found.max_abs_delta:.4g}."
    yield f"- The optimal values of the two tasks, Q*, differ by at most {found.task_distance:.4g}."
    yield (
        f"- Theorem 1 {holds[found.theorem1_holds]}: that is at most max |delta| / (1 - gamma) = "
        f"{found.theorem1_bound:.4g}."
    )
    yield (
        f"- From the start state the optimal return is {found.v_source:.4g} in the source task and "
        f"{found.v_target:.4g} in the target task."
    )
    yield (
        f"- Theorem 3 {holds[found.theorem3_holds]}: following the source's policy in the target task stays within its "
        f"bounds, nowhere closer to one than {found.theorem3_slack:.4g}."
    )
