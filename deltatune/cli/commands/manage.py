"""Commands that list, compare, rename and remove sweeps."""

from __future__ import annotations

import logging
import sys
import time
from dataclasses import asdict
from typing import TYPE_CHECKING, Annotated, Any

import typer

from deltatune.cli.app import (
    RESULTS,
    RUN_PANEL,
    Json,
    Storage,
    Sweep,
    TrackingUri,
    app,
    busy,
    findings_of,
    out,
    print_json,
    print_named,
    program,
)
from deltatune.cli.sheet import table
from deltatune.cli.tables import duration

if TYPE_CHECKING:
    from orchestrator.results.sweep_folder import Results

log = logging.getLogger("deltatune.tracking")


@app.command("list", rich_help_panel=RUN_PANEL)
def list_(storage: Storage = RESULTS, as_json: Json = False) -> None:
    """List the sweeps of a storage folder: dates, progress, largest effect of transfer, cost."""
    from orchestrator.results.status import sweeps

    found = [_overview(results) for results in sweeps(storage, None)]
    found.sort(key=lambda data: data["changed"] or data["created"], reverse=True)
    if as_json:
        print_json(found)
        return
    if not found:
        out.print(f"{storage} holds no sweep yet: {program()} sweep demo", soft_wrap=True)
        return
    columns = ("sweep", "created", "last cell", "cells done", "failed", "largest effect of transfer", "core time")
    out.print(table(columns, [_line(data) for data in found]))


def _overview(results: Results) -> dict[str, Any]:
    """Return the entry of `list` for a sweep, from its records and its best.yaml."""
    from orchestrator.export.largest_effect import largest_effect
    from orchestrator.results.lock import driver

    heads = [head for _, _, head in results.planned_heads()]
    ended = [head for head in heads if head is not None]
    return {
        "sweep": results.name,
        "created": results.meta()["created"],
        "changed": max((head.finished for head in ended), default=None),
        "cells": len(heads),
        "done": sum(head.status == "done" for head in ended),
        "failed": sum(head.status == "failed" for head in ended),
        "largest_effect": largest_effect(results.folder / "best.yaml"),
        "core_seconds": sum(head.seconds for head in ended),
        "driver": driver(results.folder),
    }


def _line(data: dict[str, Any]) -> tuple[str, ...]:
    effect = data["largest_effect"]
    said = "-"
    if effect is not None:
        ratio, low, high = (100 * effect[key] for key in ("value", "low", "high"))
        said = f"{ratio:+.0f}% [{low:+.0f}, {high:+.0f}] {effect['agent']} on {effect['task']}"
    last = "running" if data["driver"] else _date(data["changed"])
    cells = f"{data['done']} of {data['cells']}"
    return data["sweep"], _date(data["created"]), last, cells, str(data["failed"]), said, duration(data["core_seconds"])


def _date(seconds: float | None) -> str:
    return "-" if seconds is None else time.strftime("%Y-%m-%d %H:%M", time.localtime(seconds))


@app.command(rich_help_panel=RUN_PANEL)
def compare(
    first: Annotated[str, typer.Argument(metavar="A", help="A sweep.")],
    second: Annotated[str, typer.Argument(metavar="B", help="Another sweep.")],
    storage: Storage = RESULTS,
    as_json: Json = False,
) -> None:
    """Compare the best configurations of two sweeps, where both have the same task, agent and source.

    On the unseen seeds, marked *, where both sweeps have confirmed them.

    The difference is B - A in AUC, paired by the seeds that both have, with its 95 % interval.
    """
    both = [findings_of(storage, name) for name in (first, second)]
    from orchestrator.analysis.comparison import compare as compared
    from orchestrator.analysis.metrics import DIFFERENCE
    from trainables.plugins.names import short

    found = compared(*both)
    if as_json:
        print_json(asdict(found))
        return
    columns = ("task", "agent", "source", f"AUC in {first}", f"AUC in {second}", "difference [95%]", "verdict")
    rows: list[tuple[Any, ...]] = []
    last = ""
    for row in found.rows:
        task = short(row.task)
        gap = DIFFERENCE.text(row.difference) if row.difference else "no seed in common"
        aucs = tuple(f"{auc:.2f}{'*' if row.confirmed else ''}" for auc in (row.first, row.second))
        rows.append(("" if task == last else task, short(row.agent), row.source, *aucs, gap, row.verdict))
        last = task
    out.print(table(columns, rows, "Best configurations by mean AUC over seeds"))
    if any(row.confirmed for row in found.rows):
        out.print("* on seeds that had no part in selecting the configuration", soft_wrap=True)
    if found.note:
        out.print(found.note, soft_wrap=True, style="yellow")
    for name, only in ((first, found.only_first), (second, found.only_second)):
        if only:
            out.print(f"Only in {name}: {'; '.join(short(each) for each in only)}", soft_wrap=True)


@app.command(rich_help_panel=RUN_PANEL)
def rm(
    names: Annotated[list[str], typer.Argument(metavar="SWEEP...", help="The sweeps to remove.")],
    yes: Annotated[bool, typer.Option("-y", "--yes", help="Do not ask.")] = False,
    storage: Storage = RESULTS,
    as_json: Json = False,
) -> None:
    """Remove sweeps with all their results. Their sources stay in the source library, their runs in MLflow."""
    from orchestrator.results.admin import remove
    from orchestrator.results.sweep_folder import Results
    from trainables.errors import InputError

    found = [Results.open(storage, name) for name in names]
    if not yes:
        if not sys.stdin.isatty():
            raise InputError(f"rm removes {', '.join(str(each.folder) for each in found)} for good: confirm with --yes")
        cells = sum(len(each.heads()) for each in found)
        typer.confirm(f"Remove {', '.join(names)} with {cells} ended cells?", abort=True)
    for results in found:
        remove(results)
    if as_json:
        print_json({"removed": [str(each.folder) for each in found]})
    else:
        out.print(f"removed {', '.join(str(each.folder) for each in found)}", soft_wrap=True)


@app.command(rich_help_panel=RUN_PANEL)
def mv(
    name: Sweep,
    new: Annotated[str, typer.Argument(metavar="NEW_NAME", help="The new name.")],
    storage: Storage = RESULTS,
    tracking_uri: TrackingUri = None,
    as_json: Json = False,
) -> None:
    """Rename a sweep, and its runs in MLflow."""
    from orchestrator.results.admin import rename
    from orchestrator.results.sweep_folder import Results
    from orchestrator.tracking.uri import tracking_uri as store_uri

    uri = store_uri(storage, tracking_uri)
    with busy(f"renaming {name}"):
        moved = rename(Results.open(storage, name), new)
        runs = _rename_in_mlflow(moved, name, uri)
    if as_json:
        print_json({"sweep": moved.name, "folder": str(moved.folder), "mlflow_runs": runs})
        return
    out.print(f"renamed {name} to {moved.name}: {moved.folder}", soft_wrap=True)
    if runs:
        out.print(f"MLflow:   {runs} runs have the new name", soft_wrap=True)


def _rename_in_mlflow(moved: Results, old: str, uri: str) -> int:
    """Rename a sweep's runs, and return how many there are; a store that does not answer is named in a warning."""
    from orchestrator.process_env import prepare
    from orchestrator.tracking.trackers import kind_of
    from orchestrator.tracking.uri import local_database

    path = local_database(uri) if kind_of(uri).has_registry else None
    if not kind_of(uri).has_registry or (path is not None and not path.exists()):
        return 0
    prepare()
    from orchestrator.tracking.mlflow.rename import rename_runs

    try:
        return rename_runs(moved, old, uri)
    except Exception as error:  # whatever a store and its connection raise; the sweep itself is renamed
        log.info("the runs of %s in %s keep their name", old, uri, exc_info=error)
        why = (str(error).splitlines() or [type(error).__name__])[0]
        what = f"{why}; '{program()} sync {moved.name}' writes its runs under the new name"
        print_named("MLflow keeps the old name", what, "yellow")
        return 0
