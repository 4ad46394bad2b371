"""The contrast of two agents of a sweep."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from deltatune.cli.app import RESULT_PANEL, RESULTS, Json, Storage, Sweep, app, findings_of, out, print_json


@app.command(rich_help_panel=RESULT_PANEL)
def contrast(
    name: Sweep,
    a: Annotated[str | None, typer.Argument(metavar="A", help="An agent of the sweep.")] = None,
    b: Annotated[str | None, typer.Argument(metavar="B", help="The agent that A is held against.")] = None,
    every: Annotated[bool, typer.Option("--all", help="Every pair of agents.")] = False,
    early: Annotated[bool, typer.Option("--early", help="Compare the AUC until the advice ends.")] = False,
    output: Annotated[
        Path | None, typer.Option("-o", "--output", metavar="FILE.csv", help="Write the numbers in full to this file.")
    ] = None,
    storage: Storage = RESULTS,
    as_json: Json = False,
) -> None:
    """Show the differences A - B between agents of a sweep on the same target with the same source, paired by seed.

    Without agents: each against those that it builds on (delta_es - es) and against the agent without transfer.
    The p-values are corrected by Holm's method for as many comparisons as are shown.
    """
    from deltatune.cli.tables import contrast_table
    from orchestrator.analysis.contrasts.table import caption, comparisons, number_table, numbers
    from trainables.errors import InputError
    from trainables.storage.atomic import write_atomic
    from trainables.storage.folders import make_folder

    if output is not None and output.suffix != ".csv":
        raise InputError(f"--output must name a .csv file (got {output})")
    found = findings_of(storage, name).contrast(a, b, every, "early_auc" if early else "auc")
    if output is not None:
        make_folder(output.absolute().parent)
        write_atomic(output.absolute(), number_table(found).to_csv(index=False).encode())
    if as_json:
        print_json({"sweep": name, "comparisons": comparisons(found), "contrasts": [numbers(each) for each in found]})
        return
    out.print(contrast_table(found, caption(found)))
    if output is not None:
        out.print(f"{len(found)} contrasts: {output}", soft_wrap=True)
