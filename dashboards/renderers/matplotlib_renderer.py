"""Figures as PNG and SVG, by matplotlib."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import matplotlib
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.backends.backend_svg import FigureCanvasSVG
from matplotlib.figure import Figure as Sheet
from matplotlib.patches import Rectangle

from dashboards.figure_model import Absent, Band, Chart, Figure, Level, Matrix, Panel, Series
from dashboards.style import HELPED, HURT, MARKERS, look

SETTINGS: dict[Any, Any] = {
    "font.size": 9,
    "axes.grid": True,
    "axes.spines.right": False,
    "axes.spines.top": False,
    "grid.alpha": 0.25,
    "legend.frameon": False,
    "svg.hashsalt": "deltatune",
    "svg.fonttype": "none",
}

MAX_PANELS = 24
"""Of one printed figure; the report has them all."""


MAX_LETTERS = 30
"""Of an entry in a legend of two columns."""


def draw(figure: Figure, sweep: str, folder: Path) -> list[Path]:
    """Write a figure as PNG and SVG to `folder`, the same bytes for the same figure; nothing for an absent one."""
    sheet = drawing(figure, sweep)
    return _save(sheet, folder, figure.name) if sheet is not None else []


def drawing(figure: Figure, sweep: str) -> Sheet | None:
    """Return a figure as a matplotlib Figure, or None for an absent one."""
    if isinstance(figure, Absent):
        return None
    matplotlib.rcParams.update(SETTINGS)
    sheet = _matrix(figure) if isinstance(figure, Matrix) else _chart(figure)
    sheet.suptitle(_plain(f"{sweep}: {figure.title}"), fontsize=10)
    return sheet


def _save(sheet: Sheet, folder: Path, name: str) -> list[Path]:
    folder.mkdir(exist_ok=True)
    paths = [folder / f"{name}.png", folder / f"{name}.svg"]
    sheet.draw_without_rendering()
    sheet.set_layout_engine("none")  # laid out once for both files: half the time
    sheet.dpi = 150  # by the canvases themselves, for savefig draws everything once more to find its extent
    FigureCanvasAgg(sheet).print_png(paths[0], metadata={"Software": None})  # type: ignore[no-untyped-call]
    FigureCanvasSVG(sheet).print_svg(paths[1], metadata={"Date": None})  # type: ignore[no-untyped-call]
    return paths


def _plain(text: str) -> str:
    """Return `text` escaped, so that matplotlib reads no formula in it."""
    return text.replace("$", r"\$")


def _grid(number: int, columns: int, width: float, height: float) -> tuple[Sheet, list[Axes]]:
    columns = min(columns, number)
    rows = math.ceil(number / columns)
    sheet = Sheet(figsize=(width * columns + 0.4, height * rows + 0.4), layout="constrained")
    axes = list(sheet.subplots(rows, columns, squeeze=False).flat)
    for unused in axes[number:]:
        unused.remove()
    return sheet, axes[:number]


def _chart(chart: Chart) -> Sheet:
    panels = chart.panels[:MAX_PANELS]
    rows = max((len(panel.y_ticks) for panel in panels), default=0)
    named = max(_legend_rows(panel)[0] for panel in panels)
    height = 0.2 * rows + 1.2 if rows else 2.8 + 0.17 * named
    sheet, every = _grid(len(panels), chart.columns, 6.2 if rows else 4.4, max(height, 2.4))
    for axes, panel in zip(every, panels, strict=True):
        _panel(axes, panel)
    return sheet


def _legend_rows(panel: Panel) -> tuple[int, int]:
    """Return (rows, columns) of a panel's legend: two columns where its entries are short."""
    words = [series.label for series in panel.series] + [level.label for level in panel.levels if level.label]
    columns = 2 if max(map(len, words), default=0) <= MAX_LETTERS else 1
    return math.ceil(len(words) / columns), columns


def _panel(axes: Axes, panel: Panel) -> None:
    bars = [series for series in panel.series if series.form == "bars"]
    for series in panel.series:
        if series.form == "bars":
            _bars(axes, series, bars.index(series), len(bars))
        elif series.form == "line":
            _line(axes, series)
        else:
            _points(axes, series)
    for level in panel.levels:
        _level(axes, level)
    axes.set_title(_plain(panel.title.replace(": ", "\n", 1)), fontsize=9)
    axes.set_xlabel(_plain(panel.x_title), labelpad=1)
    axes.set_ylabel(_plain(panel.y_title))
    if panel.x_log:
        axes.set_xscale("log")
    if panel.x_ticks:
        axes.set_xticks(range(len(panel.x_ticks)), [_plain(tick) for tick in panel.x_ticks])
    if panel.y_ticks:
        axes.set_yticks(range(len(panel.y_ticks)), [_plain(tick) for tick in panel.y_ticks], fontsize=7)
        axes.set_ylim(len(panel.y_ticks) - 0.5, -0.5)
    else:
        axes.legend(fontsize=7, ncols=_legend_rows(panel)[1], loc="upper center", bbox_to_anchor=(0.5, -0.16))
    if panel.x_range:
        axes.set_xlim(*panel.x_range)
    if panel.y_range:
        axes.set_ylim(*panel.y_range)


def _dash(agent: str) -> Any:
    dash = look(agent).dash
    return (0, dash) if dash else "-"


def _line(axes: Axes, series: Series) -> None:
    colour, thin = look(series.agent).light, series.faint
    x: Any = series.x
    y: Any = series.y
    axes.plot(x, y, ls=_dash(series.agent), color=colour, label=_plain(series.label), lw=0.7 if thin else 1.4)
    if series.band:
        low: Any = series.band[0]
        high: Any = series.band[1]
        axes.fill_between(x, low, high, color=colour, alpha=0.06 if thin else 0.16, lw=0)


def _errors(values: tuple[float | None, ...], band: Band | None) -> Any:
    """Return the distances to the two ends of an interval, (2, n), or None."""
    if band is None:
        return None
    low, high = band
    below = [0.0 if v is None or end is None else max(v - end, 0.0) for v, end in zip(values, low, strict=True)]
    above = [0.0 if v is None or end is None else max(end - v, 0.0) for v, end in zip(values, high, strict=True)]
    return [below, above]


def _points(axes: Axes, series: Series) -> None:
    colour = look(series.agent).light
    marker: dict[str, Any] = {"fmt": MARKERS[look(series.agent).marker], "ms": 5, "capsize": 2, "color": colour}
    marker |= {"mfc": "none"} if series.hollow else {}
    marker |= {"ls": _dash(series.agent), "lw": 1.0} if series.form == "linked" else {}
    x: Any = series.x
    y: Any = series.y
    errors = {"xerr": _errors(series.x, series.x_band), "yerr": _errors(series.y, series.band)}
    axes.errorbar(x, y, label=_plain(series.label), elinewidth=1.0, **errors, **marker)
    middle = (min(x) + max(x)) / 2 if series.names else 0.0
    for at, name in enumerate(series.names):
        side: dict[str, Any] = {"xytext": (-6, 5), "ha": "right"} if x[at] > middle else {"xytext": (6, 5)}
        axes.annotate(_plain(name), (x[at], y[at]), textcoords="offset points", fontsize=7, **side)


def _bars(axes: Axes, series: Series, number: int, of: int) -> None:
    width = 0.8 / of
    at = [(x or 0.0) + (number - (of - 1) / 2) * width for x in series.x]
    heights = [0.0 if y is None else y for y in series.y]
    style: dict[str, Any] = {"color": look(series.agent).light, "capsize": 3, "yerr": _errors(series.y, series.band)}
    axes.bar(at, heights, width * 0.92, label=_plain(series.label), **style)


def _level(axes: Axes, level: Level) -> None:
    colour = look(level.agent).light if level.agent else "#4d4d4d"
    style: dict[str, Any] = {"color": colour, "lw": 0.9, "ls": "--" if level.agent else "-"}
    style |= {"label": _plain(level.label)} if level.label else {}
    (axes.axvline if level.upright else axes.axhline)(level.value, **style)


def _matrix(matrix: Matrix) -> Sheet:
    sheet, (axes,) = _grid(1, 1, 1.7 * len(matrix.columns) + 3.2, 0.3 * len(matrix.rows) + 1.1)
    axes.grid(False)
    for i, texts in enumerate(matrix.texts):
        for j, text in enumerate(texts):
            tint = {"helped": HELPED, "hurt": HURT}.get(matrix.verdicts[i][j], "#8a8a8a")
            axes.add_patch(Rectangle((j - 0.5, i - 0.5), 1, 1, color=tint, alpha=0.2, lw=0))
            axes.text(j, i, text, ha="center", va="center", fontsize=8)
    axes.set_xticks(range(len(matrix.columns)), [_plain(name) for name in matrix.columns], fontsize=7)
    axes.set_yticks(range(len(matrix.rows)), [_plain(f"{a}, {k}, from {s}") for s, k, a in matrix.rows], fontsize=7)
    axes.set_xlim(-0.5, len(matrix.columns) - 0.5)
    axes.set_ylim(len(matrix.rows) - 0.5, -0.5)
    return sheet
