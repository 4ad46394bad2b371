"""Commands that publish and restore datasets, and train recorded cells again."""

from __future__ import annotations

import shlex
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from deltatune.cli.app import (
    RESULT_PANEL,
    RESULTS,
    RUN_PANEL,
    Files,
    Json,
    Storage,
    app,
    load_files,
    out,
    print_json,
    program,
)
from trainables.errors import InputError

if TYPE_CHECKING:
    from orchestrator.dataset.dataset import Dataset

Folder = Annotated[Path, typer.Argument(metavar="FOLDER", help="The dataset's folder.")]


@app.command(rich_help_panel=RUN_PANEL)
def replay(
    cell_id: Annotated[
        str, typer.Argument(metavar="CELL_ID", help="16 hexadecimal digits: the cell_id of SWEEP/cells.parquet.")
    ],
    name: Annotated[str | None, typer.Option("--sweep", metavar="SWEEP", help="Look only in this sweep.")] = None,
    file: Files = None,
    published: Annotated[
        bool, typer.Option("--published", help="Take the cell from the dataset of deltatune's own repository.")
    ] = False,
    dataset: Annotated[
        Path | None, typer.Option("--dataset", metavar="FOLDER", help="Take the cell from this published dataset.")
    ] = None,
    storage: Storage = RESULTS,
    as_json: Json = False,
) -> None:
    """Run one recorded cell again in this process, and compare every bit of its curve (exit 1 if one differs)."""
    from orchestrator.execution.replay import replay as run_again
    from orchestrator.execution.replay import replay_published

    load_files(file)
    if published or dataset is not None:
        if name is not None:
            raise InputError(f"--sweep is for recorded sweeps, not for published cells (got '{name}')")
        found = replay_published(_opened(dataset or _own_dataset()), cell_id, storage)
    else:
        found = run_again(storage, cell_id, name)
    if as_json:
        print_json(asdict(found))
    else:
        verdict = "every bit agrees" if found.agrees else f"NOT the same: {found.first_difference}"
        out.print(f"{found.agent} on {found.task}, seed {found.seed}, {found.points} evaluation points: {verdict}")
    if not found.agrees:
        raise typer.Exit(1)


@app.command(rich_help_panel=RESULT_PANEL)
def publish(
    folder: Folder,
    sweeps: Annotated[list[str], typer.Argument(metavar="SWEEP...", help="The sweeps that go into it.")],
    remarks: Annotated[
        Path | None, typer.Option(metavar="FILE.md", help="Markdown for the data card: content and authors.")
    ] = None,
    storage: Storage = RESULTS,
    as_json: Json = False,
) -> None:
    """Publish sweeps as a dataset: Parquet tables, data card, licence and checksums; each row can be replayed.

    Other sweeps in the dataset stay; an older state of these sweeps is replaced.
    """
    from deltatune.cli.app import warn_of_damage
    from orchestrator.dataset.publication import write
    from orchestrator.results.sweep_folder import Results

    opened = [warn_of_damage(Results.open(storage, sweep)) for sweep in sweeps]
    try:
        text = remarks.read_text() if remarks else ""
    except (OSError, UnicodeError) as error:
        raise InputError(f"cannot read {remarks}: {error}") from None
    made = write(folder, opened, text)
    cells = len(made.cells)
    if as_json:
        print_json({"dataset": str(folder), "sweeps": made.sweeps(), "cells": cells})
    else:
        out.print(f"Dataset:  {folder} ({cells} cells of {', '.join(made.sweeps())})", soft_wrap=True)


@app.command(rich_help_panel=RESULT_PANEL)
def restore(
    folder: Folder,
    sweeps: Annotated[
        list[str] | None, typer.Argument(metavar="[SWEEP...]", help="The sweeps to restore; default: all.")
    ] = None,
    storage: Storage = RESULTS,
    as_json: Json = False,
) -> None:
    """Write the records of a published dataset to a storage folder, as if its sweeps had run there.

    Then `report`, `compare` and `export` work on them, and the command of a sweep runs its missing cells.
    """
    from orchestrator.execution import sweep

    dataset = _opened(folder)
    names = sweeps or dataset.sweeps()
    for name in names:
        dataset.space(name)
    written = {name: sweep.restore(dataset, name, storage) for name in names}
    if as_json:
        print_json(written)
        return
    for name, count in written.items():
        there = "" if storage == RESULTS else f" --storage {shlex.quote(str(storage))}"
        out.print(f"{name}: {count} records; {program()} sweep --name {name}{there} continues it", soft_wrap=True)


def _opened(folder: Path) -> Dataset:
    from orchestrator.dataset.dataset import Dataset

    return Dataset(folder)


def _own_dataset() -> Path:
    """Return docs/dataset in this folder, or in the checkout of this code."""
    from orchestrator.results.provenance import packages_folder

    there = Path("docs") / "dataset"
    return there if there.is_dir() else packages_folder() / there
