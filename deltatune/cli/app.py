"""What the commands share: the application, the consoles and the common options."""

from __future__ import annotations

import json
import logging
import os
import shutil
import sys
from contextlib import AbstractContextManager, nullcontext
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import click
import typer
from rich.console import Console
from rich.text import Text
from typer.core import TyperGroup

from trainables.storage.paths import storage_path

if TYPE_CHECKING:
    from orchestrator.analysis.findings import Findings
    from orchestrator.results.sweep_folder import Results

ORDER = (
    *("sweep", "status", "list", "watch", "logs", "compare", "replay", "mv", "rm"),
    *("report", "contrast", "importance", "export", "play", "ui", "sync", "publish", "restore"),
    *("tasks", "agents", "spaces", "bounds", "sources", "rank"),
    *("check", "init"),
    *("submit",),
)
"""Commands in the order of the help."""


class Commands(TyperGroup):
    """Lists the commands in the order of ORDER, and shows no value type for flags in the help."""

    def list_commands(self, ctx: Any) -> list[str]:
        """Return the names of the commands in order."""
        return sorted(self.commands, key=lambda name: ORDER.index(name) if name in ORDER else len(ORDER))

    def get_params(self, ctx: Any) -> list[Any]:
        """Return the parameters of the group."""
        return _without_types(super().get_params(ctx))

    def get_command(self, ctx: Any, cmd_name: str) -> Any:
        """Return a command."""
        command = super().get_command(ctx, cmd_name)
        if command is not None:
            _without_types(command.get_params(ctx))
        return command


def _without_types(parameters: list[Any]) -> list[Any]:
    for parameter in parameters:
        if getattr(parameter, "is_flag", False):
            parameter.metavar = ""
    return parameters


app = typer.Typer(
    cls=Commands,
    no_args_is_help=True,
    rich_markup_mode="markdown",
    pretty_exceptions_enable=False,
    help="Does knowledge from this task help or hurt on that one?\n\n"
    "Sweeps of transfer agents, with delta as the gatekeeper of transfer. Start with `deltatune sweep demo`, "
    "then open its results with `deltatune ui`.",
)

RUN_PANEL, RESULT_PANEL, CATALOGUE_PANEL, CUSTOM_PANEL, CLUSTER_PANEL = (
    "Run and follow sweeps",
    "Look at results",
    "Tasks, agents, search spaces and sources",
    "Custom tasks and agents",
    "Clusters",
)
"""Groups of commands in the help."""


def _console(stderr: bool) -> Console:
    """Return a console; where its stream is no terminal, lines may be 160 columns wide."""
    stream = sys.stderr if stderr else sys.stdout
    terminal = stream is not None and stream.isatty()  # None: it is closed
    return Console(stderr=stderr, highlight=False, markup=False, width=None if terminal else 160)


out, err = _console(stderr=False), _console(stderr=True)

Json = Annotated[bool, typer.Option("--json", help="Print JSON for programs.")]
Storage = Annotated[
    Path,
    typer.Option(
        parser=storage_path,
        metavar="FOLDER",
        envvar="DELTATUNE_STORAGE",
        help="The folder of all sweeps, of the source library and of MLflow's store; or a URL: s3://BUCKET/FOLDER.",
    ),
]
Sweep = Annotated[str, typer.Argument(metavar="SWEEP", help="A sweep's name in the storage folder, or its folder.")]
TrackingUri = Annotated[
    str | None,
    typer.Option(
        metavar="URI",
        help="The MLflow store to write to, or jsonl:FOLDER for files of JSON lines; default: MLFLOW_TRACKING_URI, "
        "else mlflow.db in the storage folder.",
    ),
]
Files = Annotated[
    list[str] | None, typer.Option("--file", metavar="FILE.py", help="Run this file first; repeat for more.")
]
RESULTS = Path("results")


def _say_version(wanted: bool) -> None:
    if wanted:
        from orchestrator.results.provenance import commit, versions

        typer.echo(f"deltatune {versions().get('deltatune', 'unknown')} (commit {commit()})")
        raise typer.Exit


@app.callback()
def options(
    context: typer.Context,
    quiet: Annotated[bool, typer.Option("-q", "--quiet", help="Show no progress, only results and errors.")] = False,
    verbose: Annotated[
        int,
        typer.Option(
            "-v", "--verbose", count=True, metavar="", show_default=False, help="Show the log; -vv its details too."
        ),
    ] = 0,
    version: Annotated[
        bool, typer.Option("--version", callback=_say_version, is_eager=True, help="Print the version and its commit.")
    ] = False,
) -> None:
    """Apply the options that come before a command."""
    context.obj = {"quiet": quiet}
    if verbose:
        handler = logging.StreamHandler()
        handler.setFormatter(logging.Formatter("%(asctime)s %(name)s: %(message)s", "%H:%M:%S"))
        logger = logging.getLogger("deltatune")  # the parent of all of deltatune's loggers
        logger.addHandler(handler)
        logger.setLevel(logging.DEBUG if verbose > 1 else logging.INFO)


def progress_console(context: typer.Context, as_json: bool) -> Console:
    """Return the console for progress: a silent one with --quiet, standard error with --json."""
    if (context.obj or {}).get("quiet"):
        return Console(quiet=True)
    return err if as_json else out


def busy(text: str) -> AbstractContextManager[object]:
    """Show on a terminal what a command is doing until its block ends; nothing with --quiet."""
    context = click.get_current_context(silent=True)
    quiet = context is not None and (context.find_root().obj or {}).get("quiet")
    return nullcontext() if quiet else err.status(text)


def findings_of(storage: Path, name: str) -> Findings:
    """Return a sweep's findings, after a warning for each damaged part of its records."""
    with busy(f"reading {name}"):
        from orchestrator.analysis.findings import find
        from orchestrator.results.sweep_folder import Results

        return find(warn_of_damage(Results.open(storage, name)))


def load_files(paths: list[str] | None) -> None:
    """Run the files of --file, which define custom tasks and agents."""
    from trainables.plugins.loader import load_file

    for path in paths or ():
        load_file(path)


def program() -> str:
    """Return how this program was called, `deltatune` or a path, for the commands that messages suggest."""
    called = sys.argv[0]
    found = shutil.which(Path(called).name)
    if found is not None and Path(found).resolve() == Path(called).resolve():
        return Path(called).name
    if Path(called).name == "__main__.py":
        return "python -m deltatune"
    return os.path.relpath(called) if Path(called).name == "deltatune" else "deltatune"


def warn_of_damage(results: Results) -> Results:
    """Return `results`, after a warning on standard error for each damaged part of its records."""
    from orchestrator.results.lock import driver

    for damage in results.damage(running=driver(results.folder) is not None):
        text = f"warning: {damage}: their cells are missing here; run the same sweep again to repeat them"
        err.print(text, soft_wrap=True, style="yellow")
    return results


def print_named(name: str, text: str, style: str = "bold") -> None:
    """Print 'name: text' with the name in `style`. Neither is read as markup."""
    out.print(Text.assemble((name, style), ": ", text), soft_wrap=True)


def print_json(data: Any) -> None:
    """Print data for a program: valid JSON on standard output, nothing else."""
    typer.echo(json.dumps(data, indent=2, ensure_ascii=False, allow_nan=False))
