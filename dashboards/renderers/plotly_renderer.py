"""Figures as Plotly's plain data, with names of colours that the page replaces for its light and its dark theme.

`@vermilion` is an agent's colour, `@vermilion/0.15` the same with that opacity, `@ink`, `@rule` and `@accent` are
colours of the page. Every text is escaped, since Plotly interprets some HTML.
"""

from __future__ import annotations

import html
from typing import Any

from dashboards.figure_model import Band, Chart, Figure, Level, Numbers, Panel, Series
from dashboards.style import key, look, rank

Spec = dict[str, Any]
"""The arguments of Plotly.newPlot, and what the page needs: target, title, height."""


def specs(figure: Figure) -> list[Spec]:
    """Return one spec per panel; none for an absent figure, or for a matrix, which the page shows as a table."""
    if isinstance(figure, Chart):
        return [_panel(panel) for panel in figure.panels]
    return []


def agents(figure: Figure) -> list[str]:
    """Return the agents of a chart, for its legend."""
    if not isinstance(figure, Chart):
        return []
    return sorted({series.agent for panel in figure.panels for series in panel.series}, key=rank)


def _text(text: str) -> str:
    return html.escape(text, quote=False)


def _rounded(values: Numbers) -> list[float | None]:
    """Return the values in five digits: more than a screen shows, in a third of the bytes."""
    return [None if value is None else float(f"{value:.5g}") for value in values]


def _panel(panel: Panel) -> Spec:
    x: Spec = {"title": {"text": _text(panel.x_title), "standoff": 8}, "automargin": True}
    y: Spec = {"title": {"text": _text(panel.y_title), "standoff": 6}, "automargin": True}
    if panel.x_ticks:
        x |= {"tickvals": list(range(len(panel.x_ticks))), "ticktext": [_text(tick) for tick in panel.x_ticks]}
        x |= {"range": [-0.5, len(panel.x_ticks) - 0.5]}
    if panel.y_ticks:
        y |= {"tickvals": list(range(len(panel.y_ticks))), "ticktext": [_text(tick) for tick in panel.y_ticks]}
        y |= {"range": [len(panel.y_ticks) - 0.5, -0.5]}
    x |= {"type": "log"} if panel.x_log else {}
    x |= {"range": list(panel.x_range)} if panel.x_range else {}
    y |= {"range": list(panel.y_range)} if panel.y_range else {}
    data = [trace for series in panel.series for trace in _traces(series)]
    shapes = [_shape(level) for level in panel.levels]
    marks = [_mark(level, place) for place, level in enumerate(panel.levels) if level.label]
    layout = {"xaxis": x, "yaxis": y, "shapes": shapes, "annotations": marks, "barmode": "group"}
    height = 60 + 24 * len(panel.y_ticks) if panel.y_ticks else 300
    spec = {"title": panel.title, "target": panel.target, "height": height, "data": data, "layout": layout}
    return spec | {"alt": _alt(panel)}


def _alt(panel: Panel) -> str:
    """Return a panel in words: where each line begins and ends, or where the points are."""
    said = []
    for series in panel.series:
        if series.faint or not series.y:
            continue
        if series.form == "line":
            said.append(f"{series.label} from {_number(series.y[0])} to {_number(series.y[-1])}")
        else:
            values = series.x if series.x_band else series.y
            said.append(f"{series.label} {', '.join(_number(value) for value in values)}")
    what = panel.x_title if panel.y_ticks else f"{panel.y_title} against {panel.x_title}"
    return f"{panel.title}. {what}: {'; '.join(said)}."


def _number(value: float | None) -> str:
    return "undefined" if value is None else f"{value:.3g}"


def _traces(series: Series) -> list[Spec]:
    shared = {"x": _rounded(series.x), "y": _rounded(series.y), "name": _text(series.label), "showlegend": False}
    shared |= {"meta": series.agent, "hoverlabel": {"namelength": -1}}
    if series.form == "line":
        return [*([_band(series)] if series.band else []), shared | _line(series)]
    shared |= {"error_x": _errors(series.x, series.x_band)} if series.x_band else {}
    shared |= {"error_y": _errors(series.y, series.band)} if series.band else {}
    if series.form == "bars":
        return [shared | {"type": "bar", "marker": {"color": f"@{key(series.agent)}"}}]
    return [shared | _points(series)]


def _line(series: Series) -> Spec:
    style = {"color": f"@{key(series.agent)}", "width": 1 if series.faint else 2, "dash": _dash(series.agent)}
    return {"type": "scatter", "mode": "lines", "line": style, "opacity": 0.6 if series.faint else 1}


def _points(series: Series) -> Spec:
    symbol = look(series.agent).marker + ("-open" if series.hollow else "")
    mode = "lines+markers" if series.form == "linked" else "markers"
    named = any(series.names)
    spec: Spec = {"type": "scatter", "mode": mode + "+text" * named, "cliponaxis": False}
    spec |= {
        "marker": {
            "color": f"@{key(series.agent)}",
            "symbol": symbol,
            "size": 9,
            "line": {"width": 1.5, "color": f"@{key(series.agent)}"},
        }
    }
    spec |= {"line": {"color": f"@{key(series.agent)}", "width": 1.5, "dash": _dash(series.agent)}}
    if series.hover:
        spec |= {"hovertext": [_text(word) for word in series.hover]}
    if named:
        places = [_beside(x, series) for x in series.x]
        spec |= {"text": [_text(name) for name in series.names], "textposition": places, "textfont": {"size": 11}}
    return spec


def _beside(x: float | None, series: Series) -> str:
    """Return where the name of a point is: towards the middle, and above it except in a forest plot."""
    places = [place for place in series.x if place is not None]
    middle = 0.0 if series.x_band else (min(places) + max(places)) / 2
    return ("middle " if series.x_band else "top ") + ("left" if (x or 0.0) > middle else "right")


def _band(series: Series) -> Spec:
    """Return the interval as one closed outline: along the top, and back along the bottom."""
    assert series.band is not None
    low, high = (_rounded(end) for end in series.band)
    x = _rounded(series.x)
    fill = f"@{key(series.agent)}/{0.07 if series.faint else 0.18}"
    spec: Spec = {"type": "scatter", "mode": "lines", "fill": "toself", "fillcolor": fill, "line": {"width": 0}}
    spec |= {"x": x + x[::-1], "y": high + low[::-1], "hoverinfo": "skip", "showlegend": False, "meta": series.agent}
    return spec


def _errors(values: Numbers, band: Band | None) -> Spec:
    assert band is not None
    low, high = band
    above = [0.0 if v is None or end is None else max(end - v, 0.0) for v, end in zip(values, high, strict=True)]
    below = [0.0 if v is None or end is None else max(v - end, 0.0) for v, end in zip(values, low, strict=True)]
    ends = {"array": _rounded(tuple(above)), "arrayminus": _rounded(tuple(below))}
    return {"type": "data", "symmetric": False, "thickness": 1.5, "width": 3, **ends}


def _dash(agent: str) -> str:
    return ",".join(f"{length * 1.3:g}px" for length in look(agent).dash) or "solid"


def _shape(level: Level) -> Spec:
    along = {"x0": level.value, "x1": level.value, "y0": 0, "y1": 1, "yref": "paper"}
    across = {"y0": level.value, "y1": level.value, "x0": 0, "x1": 1, "xref": "paper"}
    colour = f"@{key(level.agent)}" if level.agent else "@ink"
    style = {"color": colour, "width": 1.2, "dash": "4px,4px" if level.agent else "solid"}
    return {"type": "line", "line": style, "layer": "below", **(along if level.upright else across)}


def _mark(level: Level, number: int) -> Spec:
    """Return the name of a level, at the right and the left end in turn."""
    side = number % 2
    place = {
        "x": 1 - side,
        "xref": "paper",
        "xanchor": "left" if side else "right",
        "y": level.value,
        "yanchor": "bottom",
        "yshift": -2,
    }
    return {
        "text": _text(level.label),
        "showarrow": False,
        "font": {"size": 11, "color": f"@{key(level.agent)}"},
        **place,
    }
