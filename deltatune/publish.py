"""After the cells: tables, figures, the report, best.yaml and MLflow, all drawn from the records."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import pandas as pd

from dashboards.draw import draw
from orchestrator.analysis.findings import Findings, find
from orchestrator.analysis.summary_table import COLUMNS, row
from orchestrator.export.best_params import write_best
from orchestrator.results.sweep_folder import Results
from trainables.errors import InputError
from trainables.storage.folders import workbench


@dataclass(frozen=True)
class Published:
    """What a sweep's results came to."""

    findings: Findings
    report: Path
    figures: list[Path]
    best: Path | None
    """None where no configuration has all its seeds."""


def publish(results: Results) -> Published:
    """Write a sweep's tables (table.csv is the one for people: a row per configuration), report, figures, best.yaml."""
    findings = find(results, results.write_tables())
    table = pd.DataFrame([row(group) for group in findings.groups], columns=list(COLUMNS))
    there = results.folder
    with workbench(there) as folder:
        table.to_csv(folder / "table.csv", index=False)
        report, *figures = (there / path.relative_to(folder).as_posix() for path in draw(findings, folder))
        best: Path | None = there / "best.yaml"
        try:
            write_best(findings, folder / "best.yaml")
        except InputError:
            best = None
    return Published(findings, report, figures, best)


def artifacts(results: Results) -> list[Path]:
    """The files of a sweep that belong into MLflow."""
    names = ("report.html", "table.csv", "cells.parquet", "points.parquet", "best.yaml")
    files = [results.folder / name for name in names] + sorted((results.folder / "figures").glob("*"))
    return [path for path in files if path.is_file()]
