"""Commands on existing sweeps."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from deltatune.cli.app import (
    RESULT_PANEL,
    RESULTS,
    RUN_PANEL,
    Json,
    Storage,
    Sweep,
    TrackingUri,
    app,
    busy,
    err,
    findings_of,
    out,
    print_json,
    print_named,
    program,
    warn_of_damage,
)
from orchestrator.export.formats import FORMATS, write

if TYPE_CHECKING:
    from orchestrator.results.sweep_folder import Results

Format = StrEnum("Format", list(FORMATS))  # type: ignore[misc]  # its members are data
"""What `export` can write."""

YAML = Format("yaml")


@app.command(rich_help_panel=RUN_PANEL)
def status(
    name: Annotated[str | None, typer.Argument(metavar="[SWEEP]", help="A sweep; default: list all.")] = None,
    storage: Storage = RESULTS,
    as_json: Json = False,
) -> None:
    """Show a sweep's progress: cells done, failed, stopped early and missing by stage, and why cells failed."""
    from deltatune.cli.sheet import table
    from orchestrator.results.status import KEYS, sweep_status, sweeps

    found = [sweep_status(results) | {"seeds": _open_comparisons(results)} for results in sweeps(storage, name)]
    if as_json:
        print_json(found[0] if name else found)
        return
    if not found:
        out.print(f"{storage} holds no sweep yet: {program()} sweep demo", soft_wrap=True)
        return
    rows = [
        (data["sweep"], stage, *(str(counts[key]) for key in KEYS), data["driver"] or "-")
        for data in found
        for stage, counts in data["stages"].items()
    ]
    out.print(table(("sweep", "stage", *KEYS, "running in"), rows))
    for data in found:
        if data["now"]:
            print_named(data["sweep"], data["now"])
        if data["seeds"]:
            print_named(
                data["sweep"],
                "{decided} of {comparisons} comparisons decided, {open} open; up to {further} more cells".format_map(
                    data["seeds"]
                ),
            )
        for damage in data["damage"]:
            print_named(data["sweep"], damage, "red")
        for failure in data["failures"]:
            what = f"{failure['cell_id']} {failure['agent']} on {failure['task']}, seed {failure['seed']}"
            print_named(what, failure["error"], "red")


def _open_comparisons(results: Results) -> dict[str, int] | None:
    """Return how far a sequential test over seeds is; None where the seeds are fixed, or nothing can be read."""
    from collections import Counter

    from trainables.errors import InputError

    try:
        if not results.meta()["space"].get("sequential"):
            return None
        import pandas as pd

        from orchestrator.analysis.contrasts.decisions import replay

        found = replay(results.space(), pd.DataFrame(results.rows()))
    except InputError:  # the damage is said beside
        return None
    states = Counter(each.outcome.state for each in found.decisions)
    decided = states["better"] + states["worse"]
    return {"comparisons": len(found.decisions), "decided": decided, "open": states["open"], "further": found.further}


@app.command(rich_help_panel=RESULT_PANEL)
def report(
    name: Sweep,
    storage: Storage = RESULTS,
    output: Annotated[
        Path | None,
        typer.Option("-o", "--output", metavar="FOLDER", help="Write it here; default: the sweep's folder."),
    ] = None,
    show: Annotated[bool, typer.Option("--open/--no-open", help="Open it in the browser.")] = False,
    as_json: Json = False,
) -> None:
    """Draw a sweep's report: one HTML file with every table and figure in it, and each figure as PNG and SVG."""
    findings = findings_of(storage, name)
    from dashboards.draw import draw
    from deltatune.cli.sweep_report import print_contrasts, print_decisions
    from orchestrator.analysis.contrasts import decisions
    from orchestrator.analysis.contrasts.table import numbers
    from trainables.storage.folders import make_folder

    missing: list[str] = []
    with busy("drawing"):
        files = draw(findings, make_folder(output) if output else None, every=True, missing=missing)
    for why in missing:
        err.print(f"not drawn: {why}", soft_wrap=True, style="yellow")
    if as_json:
        contrasts = [numbers(each) for each in findings.contrasts]
        figures = [str(path) for path in files[1:]]
        decided = [decisions.numbers(each) for each in findings.decisions]
        print_json({"report": str(files[0]), "figures": figures, "contrasts": contrasts, "decisions": decided})
    else:
        print_contrasts(findings)
        print_decisions(findings)
        out.print(f"Report:   {files[0]}", soft_wrap=True)
        out.print(f"Figures:  {len(files) - 1} PNG and SVG files in {files[0].parent / 'figures'}", soft_wrap=True)
    if show:
        typer.launch(files[0].as_uri())


@app.command(rich_help_panel=RESULT_PANEL)
def export(
    name: Sweep,
    kind: Annotated[
        Format,
        typer.Option(
            "--format",
            help="; ".join(f"{name}: {form.what}" for name, form in FORMATS.items()),
        ),
    ] = YAML,
    output: Annotated[
        Path | None,
        typer.Option(
            "-o",
            "--output",
            help="The file to write (csv, parquet: the folder of all tables, or the file of the configurations).",
        ),
    ] = None,
    storage: Storage = RESULTS,
    as_json: Json = False,
) -> None:
    """Write a sweep's best hyperparameters per task, agent and source, for reading and for 'sweep --params'.

    Or, with --format, its results or its Table 1 for other programs.
    """
    written = write(findings_of(storage, name), kind.value, output)
    if as_json:
        print_json(written.data)
    else:
        out.print(f"{written.what}: {', '.join(str(path) for path in written.files)}", soft_wrap=True)


@app.command(rich_help_panel=RESULT_PANEL)
def sync(name: Sweep, storage: Storage = RESULTS, tracking_uri: TrackingUri = None, as_json: Json = False) -> None:
    """Write a sweep's results to MLflow or another tracker; a second run changes nothing."""
    from orchestrator.process_env import prepare

    prepare()
    from orchestrator.results.sweep_folder import Results

    results = warn_of_damage(Results.open(storage, name))
    from deltatune.publish import artifacts, publish
    from orchestrator.tracking.sync import sync_now
    from orchestrator.tracking.trackers import kind_of, without_registry
    from orchestrator.tracking.uri import shown
    from orchestrator.tracking.uri import tracking_uri as store_uri

    uri = store_uri(results.storage, tracking_uri)
    published = publish(results)
    parent, kind, sources = sync_now(published.findings, uri, artifacts(results)), kind_of(uri), list[str]()
    if kind.has_registry:
        from orchestrator.model_registry import mlflow_registry

        sources = mlflow_registry.register_now(results, uri, parent)
    if as_json:
        print_json({"sweep": results.name, kind.key: shown(uri), "run": parent, "sources": sources})
        return
    for source in sources:
        out.print(f"Source:   {source}", soft_wrap=True)
    if said := without_registry(uri):
        out.print(f"{results.name} is in {parent}; {said}.", soft_wrap=True)
    else:
        out.print(f"MLflow has {results.name}: {program()} ui --storage {results.storage}", soft_wrap=True)


@app.command(rich_help_panel=RESULT_PANEL)
def ui(
    storage: Storage = RESULTS,
    tracking_uri: TrackingUri = None,
    host: Annotated[
        str, typer.Option(metavar="ADDRESS", help="The address to listen on; 127.0.0.1: only from this machine.")
    ] = "127.0.0.1",
    port: Annotated[int, typer.Option(min=1, max=65535, metavar="PORT", help="The port to listen on.")] = 5000,
) -> None:
    """Open the MLflow UI on the sweeps of a storage folder.

    In the runs table, the filter `tags.kind = 'aggregate'` sorted by `auc` is a leaderboard.
    """
    from orchestrator.process_env import prepare

    prepare()
    from orchestrator.tracking.trackers import kind_of
    from orchestrator.tracking.uri import tracking_uri as store_uri
    from trainables.errors import InputError

    if not host.strip():
        raise InputError(f"--host must be an address such as 127.0.0.1, or 0.0.0.0 for all (got '{host}')")
    uri = store_uri(storage, tracking_uri)
    if not kind_of(uri).has_registry:
        raise InputError(f"the MLflow UI shows an MLflow store (got --tracking-uri {uri})")
    from orchestrator.tracking.ui import serve

    raise typer.Exit(serve(uri, host, port, out))
