"""What people look at: figures and the report, drawn from the results table alone."""

from __future__ import annotations

import logging
from pathlib import Path

from orchestrator.analysis.findings import Findings

__all__ = ["REPORT", "draw"]

REPORT = "report.html"

log = logging.getLogger("deltatune.report")

AT_THE_END = ("matrix", "curves", "delta_effect", "advice_fraction")
"""The pictures that a sweep draws when it ends; the others are in the report at once, and as pictures on demand."""


def draw(
    findings: Findings, folder: Path | None = None, every: bool = False, missing: list[str] | None = None
) -> list[Path]:
    """Write the report, and as PNG and SVG in the folder `figures` beside it what the sweep has the cells for.

    folder: default the sweep's own. every: all figures as pictures, not those of AT_THE_END alone. missing: is told in
    a sentence of each figure that could not be drawn; it costs no other. The files, the report first.
    """
    from dashboards import style
    from dashboards.renderers import matplotlib_renderer
    from dashboards.report import sections

    missing = [] if missing is None else missing
    style.assign(dict.fromkeys(group.agent for group in findings.groups))
    figures = sections.figures(findings, missing)
    folder = folder or findings.results.folder
    paths = [sections.write(findings, figures, folder / REPORT, missing)]
    for figure in figures:
        if every or figure.name in AT_THE_END:
            try:
                paths += matplotlib_renderer.draw(figure, findings.results.name, folder / "figures")
            except Exception as error:
                log.exception("the picture %s could not be drawn", figure.name)
                missing.append(f"{figure.name} ({type(error).__name__}: {error})")
    return paths
