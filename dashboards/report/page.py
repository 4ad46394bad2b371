"""The HTML page of the report: template, style and script, with every text escaped."""

from __future__ import annotations

import functools
import re
from collections.abc import Sequence
from dataclasses import dataclass
from importlib import resources
from pathlib import Path
from typing import Any

from jinja2 import Environment, FileSystemLoader, StrictUndefined
from markupsafe import Markup, escape

from dashboards.figure_model import Absent
from dashboards.report.reproduce import command, export_command, space_yaml
from dashboards.report.tables import Table
from dashboards.report.verdict import Verdict
from dashboards.style import PALETTE, key, look
from orchestrator.analysis.findings import Findings
from orchestrator.analysis.groups import Group
from trainables.storage.atomic import write_atomic

PAGE = Path(__file__).parent / "page"

SHAPES = {
    "circle": "M14 2.5a3.5 3.5 0 1 0 .01 0z",
    "square": "M11 3h6v6h-6z",
    "diamond": "M14 1.5l4.5 4.5-4.5 4.5-4.5-4.5z",
    "triangle-up": "M14 2l4.2 7.5h-8.4z",
    "triangle-down": "M14 10l4.2-7.5h-8.4z",
    "pentagon": "M14 1.5l4.3 3.1-1.6 5h-5.4l-1.6-5z",
    "x": "M11 1.8l3 2.7 3-2.7 1.3 1.4-2.7 2.8 2.7 2.8-1.3 1.4-3-2.7-3 2.7-1.3-1.4 2.7-2.8-2.7-2.8z",
}
"""Outline of each marker about (14, 6)."""


def swatch(agent: str) -> Markup:
    """Return an agent's line and marker as SVG, as in the charts."""
    dash = " ".join(f"{length:g}" for length in look(agent).dash)
    drawing = Markup('<svg class="swatch" viewBox="0 0 28 12" width="28" height="12" aria-hidden="true" style="{}">')
    drawing += Markup('<path class="dash" d="M0 6h28" stroke-dasharray="{}"/><path class="mark" d="{}"/></svg>')
    return drawing.format(f"color:var({variable(agent)})", dash, SHAPES[look(agent).marker])


def breakable(text: str) -> Markup:
    """Return text whose line may break after a colon, as in the name of a task."""
    return escape(text).replace(":", Markup(":<wbr>"))


def heading(text: str) -> Markup:
    """Return a column's title with a line break before its unit in brackets."""
    return Markup(re.sub(r" (?=[\[(])", " <br>", str(escape(text))))


def variable(agent: str) -> str:
    """Return the name of an agent's colour in the style sheet."""
    return f"--agent-{key(agent)}"


def palette(shade: str) -> str:
    """Return the agents' colours as CSS declarations, for 'light' or 'dark'."""
    return "".join(f"--agent-{name}:{getattr(each, shade)};" for name, each in PALETTE.items())


def _files(findings: Findings, content: Sequence[dict[str, Any]]) -> dict[str, str]:
    """Return what the page offers for download, by file name."""
    blocks = [block for part in content for block in part["blocks"]]
    tables: list[Table] = [block["table"] for block in blocks if block["kind"] == "table"]
    name = findings.results.name
    return {f"{name}-{table.id}.csv": table.csv for table in tables} | {"space.yaml": space_yaml(findings)}


@dataclass(frozen=True)
class Parts:
    """What a page shows."""

    verdict: Verdict
    content: Sequence[dict[str, Any]]
    """Sections with their blocks, in order."""
    specs: Sequence[dict[str, Any]]
    """The plots, under the numbers that the blocks give."""
    absent: Sequence[Absent]
    """What is not shown."""
    origin: Sequence[tuple[str, str]]
    winners: Sequence[Group]


@functools.cache
def _environment() -> Environment:
    """Return what compiles the template, once for all reports of this process."""
    environment = Environment(
        loader=FileSystemLoader(PAGE), autoescape=True, trim_blocks=True, lstrip_blocks=True, undefined=StrictUndefined
    )
    environment.filters |= {"breakable": breakable, "heading": heading}
    return environment


def render(path: Path, findings: Findings, parts: Parts) -> None:
    """Write the page to `path`."""
    page = (
        _environment()
        .get_template("report.html")
        .render(
            name=findings.results.name,
            description=findings.results.space().description,
            parts=parts,
            export=export_command(findings),
            winners=[(group, command(findings, group)) for group in parts.winners],
            data={"specs": parts.specs, "files": _files(findings, parts.content)},
            swatch=swatch,
            light=palette("light"),
            dark=palette("dark"),
            style=Markup((PAGE / "report.css").read_text(encoding="utf-8")),
            script=Markup((PAGE / "report.js").read_text(encoding="utf-8")),
            plotly=Markup((resources.files("plotly") / "package_data" / "plotly.min.js").read_text(encoding="utf-8")),
        )
    )
    write_atomic(path, page.encode())
