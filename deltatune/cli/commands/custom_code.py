"""Commands for custom tasks: check one, and write a search space for it."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import Annotated, Any

import typer

from deltatune.cli.app import CUSTOM_PANEL, RESULTS, Json, app, out, print_json, program
from deltatune.cli.tables import span

TASK = Annotated[
    str, typer.Argument(metavar="TASK", help="NAME, gym:ENV_ID or FILE.py:NAME, each with [:FEATURE=VALUE,...].")
]


@app.command(rich_help_panel=CUSTOM_PANEL)
def check(task: TASK, as_json: Json = False) -> None:
    """Test a task as the built-in ones are tested, time it, and estimate what a sweep costs (exit 1 if a test fails).

    FILE.py:NAME runs that file.
    """
    from deltatune.cli.sheet import table
    from deltatune.cli.task_cost import task_costs
    from trainables.plugins.loader import canonicalise
    from trainables.tasks.env_checker import check as findings
    from trainables.tasks.env_checker import refused, steps_per_second
    from trainables.tasks.registry import parse_task

    parsed = parse_task(canonicalise(task))
    rate, costs = None, []
    with out.status("checking"):
        found = list(findings(parsed))
        sound = all(finding.passed is not False for finding in found)
        if sound:
            try:
                rate, costs = steps_per_second(parsed), task_costs(parsed)
            except Exception as error:  # the task's own code, which may fail late
                found.append(refused("runs for thousands of steps, and is learned", error))
                rate, costs, sound = None, [], False
    if as_json:
        data: dict[str, Any] = {"task": parsed.name, "sound": sound, "findings": [asdict(each) for each in found]}
        print_json(data | {"environment_steps_per_second": rate, "costs": [asdict(cost) for cost in costs]})
    else:
        words = {True: "yes", False: "NO", None: "-"}
        rows = [(each.question, words[each.passed], each.answer) for each in found]
        out.print(table((parsed.name, "", ""), rows))
        if rate is not None:
            out.print(f"The environment alone makes {rate:,.0f} steps a second.")
            out.print(table(("agent", "steps a second", "a cell with default settings"), [c.row() for c in costs]))
            out.print("A sweep has agents x targets x configurations x seeds such cells: see 'sweep --dry-run'.")
    if not sound:
        raise typer.Exit(1)


@app.command(rich_help_panel=CUSTOM_PANEL)
def init(
    task: TASK,
    output: Annotated[
        Path | None, typer.Option("-o", "--output", metavar="FILE", help="The file to write; default: print.")
    ] = None,
    quick: Annotated[
        bool, typer.Option("--quick", help="A tenth of the episodes and two seeds, and print its cost.")
    ] = False,
    as_json: Json = False,
) -> None:
    """Write a commented search space for a task, to run as it is or to edit.

    Features in the name make the target task, e.g. `deltatune init 'gym:Pendulum-v1:g=2x' -o mine.yaml`.
    """
    from search_spaces.template import starter
    from trainables.errors import InputError
    from trainables.plugins.loader import canonicalise
    from trainables.storage.atomic import write_atomic
    from trainables.storage.folders import make_folder

    text = starter(task, canonicalise(task), str(output or "mine.yaml"), quick)
    if output is None:
        print_json({"yaml": text}) if as_json else typer.echo(text, nl=False)
        return
    if output.exists():
        raise InputError(f"{output} exists already: choose another -o, or remove it")
    make_folder(output.absolute().parent)
    write_atomic(output.absolute(), text.encode())
    cost = _cost(output) if quick else None
    if as_json:
        print_json({"file": str(output), "seconds": cost})
        return
    took = f"about {span(*cost)} on this machine; " if cost else ""
    out.print(f"{output}: {took}see what it would do with '{program()} sweep {output} --dry-run'", soft_wrap=True)


def _cost(file: Path) -> tuple[float, float]:
    """Return (low, high), the seconds that a sweep of the search space would take on this machine."""
    from orchestrator.cluster.resources import local_cpus
    from orchestrator.execution.forecast import forecast
    from orchestrator.execution.settings import Settings
    from orchestrator.results.sweep_folder import Results
    from search_spaces.loading import load

    with out.status("measuring"):
        space = load(str(file))
        return forecast(space, Settings(), Results(RESULTS / space.name), local_cpus()).wall
