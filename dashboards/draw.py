"""Writes the report and the figures, from the results table alone."""

from __future__ import annotations

import logging
from collections.abc import Callable
from pathlib import Path

from dashboards.renderers.drawing_process import DrawingProcess
from orchestrator.analysis.findings import Findings

__all__ = ["REPORT", "begin", "draw"]

REPORT = "report.html"

log = logging.getLogger("deltatune.report")

AT_THE_END = ("matrix", "curves", "delta_effect", "advice_fraction")
"""The figures that a sweep draws as files at its end; the report has all, and `deltatune report` draws all."""


def draw(
    findings: Findings, folder: Path | None = None, every: bool = False, missing: list[str] | None = None
) -> list[Path]:
    """Write the report, and figures as PNG and SVG in the folder `figures` next to it; return the files, report first.

    folder: default the sweep's own. every: draw all figures as files, not only those of AT_THE_END. missing: gets a
    sentence for each figure that could not be drawn; the others are drawn all the same.
    """
    return begin(findings, folder, every, missing)()


def begin(
    findings: Findings,
    folder: Path | None = None,
    every: bool = False,
    missing: list[str] | None = None,
    artist: DrawingProcess | None = None,
) -> Callable[[], list[Path]]:
    """Write the report, begin to draw the figures, and return what waits for them; see `draw`. artist: draws them."""
    from dashboards import style
    from dashboards.report import sections

    missing = [] if missing is None else missing
    style.assign(dict.fromkeys(group.agent for group in findings.groups))
    figures = sections.figures(findings, missing)
    folder, artist = folder or findings.results.folder, artist or DrawingProcess()
    wanted = [figure for figure in figures if every or figure.name in AT_THE_END]
    begun = [(figure.name, artist.draw(figure, findings.results.name, folder / "figures")) for figure in wanted]
    report = sections.write(findings, figures, folder / REPORT, missing)

    def files() -> list[Path]:
        paths = [report]
        for name, drawn in begun:
            try:
                paths += drawn()
            except Exception as error:
                log.exception("the figure %s could not be drawn", name)
                missing.append(f"{name} ({type(error).__name__}: {error})")
        return paths

    return files
