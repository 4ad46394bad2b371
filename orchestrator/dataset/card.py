"""The data card of a dataset: what is in it, how it was made, and how to use it, as Markdown."""

from __future__ import annotations

import json
from collections.abc import Iterable

import pandas as pd

from orchestrator.markdown import table

LICENCE = """\
Creative Commons Attribution 4.0 International (CC BY 4.0)

You may share and adapt this dataset for any purpose, if you give credit to its authors.
The licence: https://creativecommons.org/licenses/by/4.0/legalcode
"""

COLUMNS = {
    "`cells.parquet`: one row per sweep and cell": {
        "sweep": "the sweep; its search space is `spaces/SWEEP.json`",
        "cell_id": "the cell's content hash: equal ids, equal results",
        "agent, task, seed": "what learned what, and its seed",
        "source_task, source, source_cell": "its task, its kind (none, learned, exact), the cell that trained it",
        "group": "equal for cells that differ in their seed alone",
        "auc": "mean of the evaluation curve, in the task's return",
        "training_auc": "mean return of the training episodes",
        "initial_return, final_return, best_return, asymptotic": "points of the curve; its last tenth",
        "steps": "training steps",
        "seconds": "wall seconds that it took, on whatever machine it was",
        "finished": "seconds since 1970",
        "commit, versions": "the code and the packages that made it",
        "digest": "SHA-256 of every bit of the curve but its seconds",
        "columns": "JSON: the curve's columns and their types",
        "cell": "JSON: the whole cell, all hyperparameters in it",
    },
    "`points/SWEEP.parquet`: one row per cell and greedy evaluation": {
        "cell_id": "the cell",
        "episode, step": "training episodes and steps so far",
        "greedy_return": "undiscounted return of the greedy policy",
        "discounted_return": "the same, discounted",
        "training_return": "mean return of the training episodes since the last point",
        "all others": "statistics of the agent; empty where it has none of that name",
    },
}


def card(cells: pd.DataFrame, remarks: str = "") -> str:
    """Return the data card of the published cells; `remarks` is Markdown that follows the first paragraph."""
    done = f"{cells['cell_id'].nunique():,} cells in {len(cells):,} rows (a cell is in every sweep that has it) of "
    done += f"{cells['sweep'].nunique()} sweeps"
    hours = cells.drop_duplicates("cell_id")["seconds"].sum() / 3600
    first = f"# Data card\n\nTransfer experiments made with deltatune: {done}, {hours:.1f} core-hours of training."
    parts = [
        first,
        remarks.strip(),
        "## What is in it\n\n"
        + _text(("sweep", "task", "agent", "source", "cells", "seeds", "sources"), _counts(cells)),
        "## How to use it\n\n" + USE.format(cell=cells["cell_id"].iloc[0], sweep=cells["sweep"].iloc[0]),
        *(f"## {title}\n\n" + _text(("column", "meaning"), rows.items()) for title, rows in COLUMNS.items()),
        "## How it was made\n\n" + _made(cells),
        "## Licence\n\n" + LICENCE.strip(),
    ]
    return "\n\n".join(part for part in parts if part) + "\n"


USE = """\
Any Parquet reader opens the tables. `sha256sum -c SHA256SUMS` checks the files. From a checkout of deltatune:

```
deltatune replay {cell} --dataset FOLDER   # train a cell again, its source first, and compare every bit
deltatune restore FOLDER {sweep}           # write a sweep's records into results/
deltatune sweep --name {sweep}             # then run what it still lacks
```"""


def _counts(cells: pd.DataFrame) -> Iterable[tuple[object, ...]]:
    keys = ["sweep", "task", "agent", "source"]
    for key, group in cells.groupby(keys, sort=True):
        yield (*key, len(group), group["seed"].nunique(), group["source_cell"].nunique() or "-")


def _made(cells: pd.DataFrame) -> str:
    versions = sorted({f"{name} {version}" for text in cells["versions"] for name, version in json.loads(text).items()})
    commits = ", ".join(sorted(cells["commit"].unique()))
    return (
        f"With {', '.join(versions)}; code of {commits}. Only cells that are done are in it; a cell that failed or was "
        "stopped early has no AUC. One thread computes a cell; with these versions the same cell gave the same "
        "bits on every machine that was tried."
    )


def _text(head: Iterable[object], rows: Iterable[Iterable[object]]) -> str:
    return "\n".join(table(head, rows))
