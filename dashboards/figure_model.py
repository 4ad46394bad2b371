"""What a figure shows, as plain data: `matplotlib_renderer` draws it for print, `plotly_renderer` for the report."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

Numbers = tuple[float | None, ...]
Band = tuple[Numbers, Numbers]
"""(low, high)."""


@dataclass(frozen=True)
class Series:
    """One agent's line, points or bars in a panel."""

    agent: str
    label: str
    x: Numbers
    y: Numbers
    band: Band | None = None
    """Interval of y; a shaded band about a line, error bars elsewhere."""
    x_band: Band | None = None
    """Interval of x, as error bars."""
    form: Literal["line", "linked", "points", "bars"] = "line"
    """linked: points with error bars, joined by a line."""
    faint: bool = False
    """Drawn thin: context, not the subject."""
    hollow: bool = False
    names: tuple[str, ...] = ()
    """A word next to each point; empty: none."""
    hover: tuple[str, ...] = ()
    """The report's text for each point under the mouse."""


@dataclass(frozen=True)
class Level:
    """A reference line across a panel."""

    value: float
    label: str = ""
    agent: str = ""
    """The agent whose colour it has; empty: that of the axes."""
    upright: bool = False


@dataclass(frozen=True)
class Panel:
    """One pair of axes."""

    title: str
    x_title: str
    y_title: str
    series: tuple[Series, ...]
    target: str = ""
    """Its target task; where a chart has many, the report shows one at a time."""
    levels: tuple[Level, ...] = ()
    x_ticks: tuple[str, ...] = ()
    """Names of the places 0, 1, ... along x; empty: x is a number."""
    y_ticks: tuple[str, ...] = ()
    """The same along y, from the top."""
    x_log: bool = False
    x_range: tuple[float, float] | None = None
    y_range: tuple[float, float] | None = None


@dataclass(frozen=True)
class Chart:
    """A figure of one or more panels."""

    name: str
    """The name of its file in `figures`, and its id in the report."""
    title: str
    caption: str
    """How to read it."""
    alt: str
    """A description for readers who cannot see it."""
    panels: tuple[Panel, ...]
    columns: int = 2
    """Panels per row in print."""


@dataclass(frozen=True)
class Matrix:
    """A table of transfer ratios, coloured by verdict."""

    name: str
    title: str
    caption: str
    rows: tuple[tuple[str, str, str], ...]
    """(source task, kind of source, agent) of each."""
    columns: tuple[str, ...]
    """Target tasks."""
    texts: tuple[tuple[str, ...], ...]
    """(rows, columns): the transfer ratios as text."""
    verdicts: tuple[tuple[str, ...], ...]
    """(rows, columns): helped, hurt, undecided, or '' where there is no comparison."""


@dataclass(frozen=True)
class Absent:
    """A figure that the sweep has no data for."""

    name: str
    title: str
    reason: str
    """One sentence."""


Figure = Chart | Matrix | Absent
