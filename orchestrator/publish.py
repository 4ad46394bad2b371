"""After the cells: tables, figures, best.yaml and MLflow, all drawn from the records."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path

import pandas as pd

from orchestrator.aggregates import Group, groups
from orchestrator.describe import COLUMNS, row
from orchestrator.export import write_best
from orchestrator.plan import Key
from orchestrator.results import Results
from orchestrator.selection import Selected, select
from trainables.errors import InputError

DASHBOARDS = "dashboards"
"""The package whose `draw(results)` makes the figures. Named, not imported: dashboards stand above this package."""


@dataclass(frozen=True)
class Published:
    """What a sweep's results came to."""

    groups: list[Group]
    selected: dict[Key, Selected]
    figures: list[Path]
    best: Path | None
    """None where no configuration has all its seeds."""


def publish(results: Results) -> Published:
    """Write a sweep's tables (table.csv is the one for people: a row per configuration), figures and best.yaml."""
    cells, _ = results.write_tables()
    every = groups(cells)
    pd.DataFrame([row(group) for group in every], columns=list(COLUMNS)).to_csv(
        results.folder / "table.csv", index=False
    )
    draw: Callable[[Results], list[Path]] = import_module(DASHBOARDS).draw
    figures = draw(results)
    best: Path | None = results.folder / "best.yaml"
    try:
        write_best(results, results.folder / "best.yaml")
    except InputError:
        best = None
    return Published(every, select(every, cells), figures, best)


def artifacts(results: Results) -> list[Path]:
    """The files of a sweep that belong into MLflow."""
    names = ("table.csv", "cells.parquet", "points.parquet", "best.yaml")
    files = [results.folder / name for name in names] + sorted((results.folder / "figures").glob("*"))
    return [path for path in files if path.is_file()]
