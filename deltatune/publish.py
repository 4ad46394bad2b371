"""What a sweep writes at its end: tables, best.yaml, figures and the report, all from its records."""

from __future__ import annotations

import logging
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path

from dashboards.draw import draw
from orchestrator.analysis.contrasts.decisions import number_table as decision_numbers
from orchestrator.analysis.contrasts.table import number_table as contrast_numbers
from orchestrator.analysis.findings import Findings, find
from orchestrator.analysis.tables.summary_table import number_table, text_table
from orchestrator.export.best_params import write_best
from orchestrator.results.sweep_folder import Results
from trainables.errors import InputError
from trainables.storage.folders import staged_folder

log = logging.getLogger("deltatune.publish")


@dataclass(frozen=True)
class Published:
    """What a sweep has published."""

    findings: Findings
    report: Path | None
    """None where it could not be drawn."""
    figures: list[Path]
    best: Path | None
    """None where no configuration has all its seeds."""
    missing: list[str]
    """What could not be drawn and why, in sentences. Tables and records are complete without it."""


def publish(results: Results) -> Published:
    """Write a sweep's tables, best.yaml, figures and report.

    table.csv has a row of text per configuration, configurations.csv the same as numbers in full precision,
    contrasts.csv the differences between agents, decisions.csv what a sequential test over seeds has decided. Tables
    and best.yaml come first; a figure that cannot be drawn affects no other file.
    """
    findings = find(results, results.write_tables())
    table = text_table(findings.groups)
    there, missing = results.folder, list[str]()
    with staged_folder(there) as folder:
        table.to_csv(folder / "table.csv", index=False)
        number_table(findings.groups).to_csv(folder / "configurations.csv", index=False)
        contrast_numbers(findings.contrasts).to_csv(folder / "contrasts.csv", index=False)
        if findings.decisions:
            decision_numbers(findings.decisions).to_csv(folder / "decisions.csv", index=False)
        best: Path | None = there / "best.yaml"
        try:
            write_best(findings, folder / "best.yaml")
        except InputError:
            best = None
        drawn: list[Path] = []
        try:
            drawn = draw(findings, folder, missing=missing)
        except Exception as error:
            log.exception("the report could not be drawn")
            missing.append(f"report ({type(error).__name__}: {error})")
        files = [there / path.relative_to(folder).as_posix() for path in drawn]
    return Published(findings, files[0] if files else None, files[1:], best, missing)


def load() -> None:
    """Import the modules that `publish` needs, which takes seconds the first time."""
    for module in ("dashboards.renderers.matplotlib_renderer", "dashboards.report.sections"):
        import_module(module)


def artifacts(results: Results) -> list[Path]:
    """Return the files of a sweep that MLflow keeps as artifacts."""
    names = ["report.html", "table.csv", "configurations.csv", "contrasts.csv", "decisions.csv"]
    names += ["cells.parquet", "points.parquet", "best.yaml"]
    files = [results.folder / name for name in names] + sorted((results.folder / "figures").glob("*"))
    return [path for path in files if path.is_file()]
