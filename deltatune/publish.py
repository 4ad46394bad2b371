"""What a sweep writes at its end: tables, best.yaml, figures and the report, all from its records."""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import TypeVar

from dashboards.draw import begin
from dashboards.renderers.drawing_process import DrawingProcess
from orchestrator.analysis.contrasts.decisions import number_table as decision_numbers
from orchestrator.analysis.contrasts.table import number_table as contrast_numbers
from orchestrator.analysis.findings import Findings, find
from orchestrator.analysis.tables.summary_table import number_table, text_table
from orchestrator.export.best_params import write_best
from orchestrator.results.sweep_folder import Results
from trainables.errors import InputError
from trainables.storage.folders import staged_folder

log = logging.getLogger("deltatune.publish")

T = TypeVar("T")


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


class Publication:
    """What a sweep publishes: all but the figures is written at once, while another process may draw those.

    table.csv has a row of text per configuration, configurations.csv the same as numbers in full precision,
    contrasts.csv the differences between agents, decisions.csv what a sequential test over seeds has decided. Tables
    and best.yaml come first; a figure that cannot be drawn affects no other file.
    """

    def __init__(self, results: Results, artist: DrawingProcess | None = None) -> None:
        """artist: draws the figures; None: this process does, when they are waited for."""
        self.findings = find(results, results.write_tables())
        self._results, self._stack = results, ExitStack()
        self._missing = list[str]()
        self._published: Published | None = None
        self._failure: BaseException | None = None
        self._folder = self._stack.enter_context(staged_folder(results.folder))
        _write_tables(self.findings, self._folder)
        self._best: Path | None = results.folder / "best.yaml"
        try:
            write_best(self.findings, self._folder / "best.yaml")
        except InputError:
            self._best = None
        self._figures = self._drawn(lambda: begin(self.findings, self._folder, missing=self._missing, artist=artist))

    def published(self) -> Published:
        """Wait for the figures, and return all that was published, or raise what prevented it, once and again."""
        if self._failure is not None:
            raise self._failure
        try:
            self._published = self._published or self._end()
        except BaseException as error:
            self._failure = error
            raise
        return self._published

    def _end(self) -> Published:
        figures, there = self._figures, self._results.folder
        drawn = (figures and self._drawn(figures)) or []
        files = [there / path.relative_to(self._folder).as_posix() for path in drawn]
        self._stack.close()
        report = files[0] if files else None
        return Published(self.findings, report, files[1:], self._best, self._missing)

    def artifacts(self) -> Iterator[Path]:
        """Yield the files that MLflow keeps as artifacts, once all are written."""
        self.published()
        yield from artifacts(self._results)

    def _drawn(self, work: Callable[[], T]) -> T | None:
        """Do a part of the drawing; return None where that fails."""
        try:
            return work()
        except Exception as error:
            log.exception("the report could not be drawn")
            self._missing.append(f"report ({type(error).__name__}: {error})")
            return None


def publish(results: Results) -> Published:
    """Write a sweep's tables, best.yaml, figures and report; see Publication."""
    return Publication(results).published()


def _write_tables(findings: Findings, folder: Path) -> None:
    """Write the tables of configurations, contrasts and decisions as CSV."""
    text_table(findings.groups).to_csv(folder / "table.csv", index=False)
    number_table(findings.groups).to_csv(folder / "configurations.csv", index=False)
    contrast_numbers(findings.contrasts).to_csv(folder / "contrasts.csv", index=False)
    if findings.decisions:
        decision_numbers(findings.decisions).to_csv(folder / "decisions.csv", index=False)


def load(artist: DrawingProcess | None = None) -> None:
    """Import the modules that publishing needs, which takes seconds the first time. artist: start it too."""
    if artist is not None:
        artist.start()
    drawing = () if artist else ("dashboards.renderers.matplotlib_renderer",)
    for module in ("pyarrow.dataset", "orchestrator.results.tables.parquet", "dashboards.report.sections", *drawing):
        import_module(module)


def artifacts(results: Results) -> list[Path]:
    """Return the files of a sweep that MLflow keeps as artifacts."""
    names = ["report.html", "table.csv", "configurations.csv", "contrasts.csv", "decisions.csv"]
    names += ["cells.parquet", "points.parquet", "best.yaml"]
    files = [results.folder / name for name in names] + sorted((results.folder / "figures").glob("*"))
    return [path for path in files if path.is_file()]
