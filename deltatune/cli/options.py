"""The options of `sweep`, each declared once, in the groups of its help."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from orchestrator.execution import defaults

MAX_WORKERS = 10_000
MAX_CONFIRM = 1_000
MAX_SECONDS = 31_536_000.0
"""A year."""
MAX_CPUS, MAX_GIB = 10_000.0, 1_000_000.0

WHAT, HOW, CELL, RECORD = "What to run", "Where and how it runs", "What a cell gets", "Where results go"
"""Groups in the help."""


def _number(group: str, metavar: str, low: float, high: float, text: str) -> Any:
    """Return an option that takes a number in [low, high]."""
    return typer.Option(min=low, max=high, metavar=metavar, help=text, rich_help_panel=group)


Space = Annotated[
    str | None,
    typer.Argument(
        metavar="[SPACE]",
        help="A built-in search space (see 'deltatune spaces') or a YAML file; default: that of --name's last run.",
    ),
]

# --- what to run
Targets = Annotated[
    list[str] | None,
    typer.Option("--tasks", metavar="TASK", help="Take only this target task; repeat for more.", rich_help_panel=WHAT),
]
Agents = Annotated[
    list[str] | None,
    typer.Option("--agents", metavar="AGENT", help="Take only this agent; repeat for more.", rich_help_panel=WHAT),
]
Seeds = Annotated[
    str | None,
    typer.Option(
        metavar="N",
        help="Take N seeds, or 'auto': as many as a sequential test asks for; default: the search space's.",
        rich_help_panel=WHAT,
    ),
]
Confirm = Annotated[
    int | None,
    typer.Option(
        min=1,
        max=MAX_CONFIRM,
        metavar="N",
        help="Run what was selected, and its baselines, again on N unseen seeds.",
        rich_help_panel=WHAT,
    ),
]
Set = Annotated[
    list[str] | None,
    typer.Option(
        "--set",
        metavar="NAME=VALUE",
        help="Give a hyperparameter one value, for every agent that has it; repeat for more.",
        rich_help_panel=WHAT,
    ),
]
Params = Annotated[
    Path | None,
    typer.Option(
        metavar="FILE", help="Take the best hyperparameters that 'deltatune export' wrote.", rich_help_panel=WHAT
    ),
]
Pretrained = Annotated[
    list[str] | None,
    typer.Option(
        "--source",
        metavar="MODEL",
        help="Use this pretrained source and train none: models:/NAME@best, models:/NAME/3 or a file; repeat for more.",
        rich_help_panel=WHAT,
    ),
]
RetryFailed = Annotated[bool, typer.Option("--retry-failed", help="Run failed cells again.", rich_help_panel=WHAT)]
Reuse = Annotated[
    defaults.Reuse,
    typer.Option(
        "--reuse",
        metavar="WHAT",
        help="Take from other sweeps of the storage: 'all' cells that they have finished, 'sources', or 'none'.",
        rich_help_panel=WHAT,
    ),
]
DryRun = Annotated[bool, typer.Option("--dry-run", help="Only say what it would do and cost.", rich_help_panel=WHAT)]

# --- where and how
Workers = Annotated[
    int | None,
    typer.Option(
        min=1, max=MAX_WORKERS, metavar="N", help="Run N cells at a time; default: one per CPU.", rich_help_panel=HOW
    ),
]
Address = Annotated[
    str | None, typer.Option(metavar="HOST:PORT", help="Join this Ray cluster; 'auto' finds one.", rich_help_panel=HOW)
]
Local = Annotated[
    bool,
    typer.Option(
        "--local", help="Run without Ray: in this process, or in --workers separate processes.", rich_help_panel=HOW
    ),
]
CheckpointEvery = Annotated[float, _number(HOW, "SECONDS", 0, MAX_SECONDS, "Time between checkpoints of a long cell.")]

KeepStates = Annotated[
    float,
    _number(
        HOW,
        "GB",
        0,
        MAX_GIB,
        "Keep the end states of cells, from which more episodes continue, in at most so much of the disk per stage; "
        "0: none.",
    ),
]

# --- what a cell gets
TimeLimit = Annotated[float | None, _number(CELL, "SECONDS", 0.1, MAX_SECONDS, "Time after which a cell fails.")]
Cpus = Annotated[float, _number(CELL, "N", 0.01, MAX_CPUS, "CPUs of a cell; a fraction shares one.")]
Gpus = Annotated[float, _number(CELL, "N", 0, MAX_CPUS, "GPUs of a cell; a fraction shares one.")]
Memory = Annotated[float, _number(CELL, "GIB", 0, MAX_GIB, "Memory reserved for a cell, in GiB.")]

# --- where results go
NewName = Annotated[
    str | None,
    typer.Option(metavar="NAME", help="The sweep's name; default: the search space's.", rich_help_panel=RECORD),
]
Mlflow = Annotated[bool, typer.Option(help="Record the sweep in MLflow.", rich_help_panel=RECORD)]
