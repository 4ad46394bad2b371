"""What the commands share: the application, the consoles and the common options."""

from __future__ import annotations

import json
import os
import shutil
import sys
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.console import Console
from rich.text import Text

from trainables.storage.paths import storage_path

app = typer.Typer(
    no_args_is_help=True,
    rich_markup_mode="markdown",
    pretty_exceptions_enable=False,
    add_completion=False,
    help="Does knowledge from this task help or hurt on that one?\n\n"
    "Sweeps of transfer agents, with delta as the gatekeeper of transfer. Start with `deltatune sweep demo`, "
    "then look at it with `deltatune ui`.",
)


def _console(stderr: bool) -> Console:
    """A console that does not fold its lines at 80 columns where it is not a terminal."""
    stream = sys.stderr if stderr else sys.stdout
    return Console(stderr=stderr, highlight=False, markup=False, width=None if stream.isatty() else 160)


out, err = _console(stderr=False), _console(stderr=True)

Json = Annotated[bool, typer.Option("--json", help="Print JSON for programs.")]
Storage = Annotated[
    Path,
    typer.Option(
        parser=storage_path,
        metavar="FOLDER",
        help="Of all sweeps, the source library and MLflow's store; or a URL: s3://BUCKET/FOLDER.",
    ),
]
Sweep = Annotated[str, typer.Argument(metavar="SWEEP", help="A sweep's name in the storage folder, or its folder.")]
TrackingUri = Annotated[
    str | None, typer.Option(help="MLflow store; default: MLFLOW_TRACKING_URI, else STORAGE/mlflow.db.")
]
RESULTS = Path("results")


def program() -> str:
    """How this program was called, for the commands that it proposes: `deltatune`, or the path to it."""
    called = sys.argv[0]
    found = shutil.which(Path(called).name)
    if found is not None and Path(found).resolve() == Path(called).resolve():
        return Path(called).name
    return os.path.relpath(called) if Path(called).name == "deltatune" else "deltatune"


def print_named(name: str, text: str, style: str = "bold") -> None:
    """Print 'name: text' with the name set off. Nothing in either is taken for markup."""
    out.print(Text.assemble((name, style), ": ", text), soft_wrap=True)


def print_json(data: Any) -> None:
    """Print data for a program: valid JSON on standard output, nothing else."""
    typer.echo(json.dumps(data, indent=2, ensure_ascii=False, allow_nan=False))
