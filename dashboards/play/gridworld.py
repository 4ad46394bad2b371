"""The windy gridworld: its wind, |delta| over its states as a heat map, and the path so far."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.patheffects import Normal, Stroke
from numpy.typing import NDArray

from dashboards.play.episode import Episode, Image
from dashboards.renderers.matplotlib_renderer import SETTINGS
from trainables.tasks.spec.family import Context

WIND_ROWS = 4.2
"""Height below the grid for the wind's arrows, in rows."""
PATH, WIND = "#0072b2", "#4d4d4d"


Deltas = Sequence[NDArray[np.float64] | None]
"""|delta| (S,) of each episode's knowledge, None where unknown."""


def images(context: Context, episodes: Sequence[Episode], deltas: Deltas) -> Iterator[Image]:
    """Yield one image per step, with the episodes side by side."""
    with matplotlib.rc_context({**SETTINGS, "axes.grid": False}):
        figure = Figure(figsize=(0.9 + 4.1 * len(episodes), 4.7), dpi=90, layout="constrained")
        canvas: Any = FigureCanvasAgg(figure)
        axes = list(figure.subplots(1, len(episodes), squeeze=False)[0])
        _heat(figure, axes, deltas, len(context["wind"]))
        for each, episode in zip(axes, episodes, strict=True):
            _grid(each, context, episode)
        moving = [_moving(each, context) for each in axes]
        canvas.draw()
        empty = canvas.copy_from_bbox(figure.bbox)
        for step in range(max(episode.steps for episode in episodes) + 1):
            canvas.restore_region(empty)
            for each, episode, artists in zip(axes, episodes, moving, strict=True):
                _move(each, episode, artists, step, len(context["wind"]))
            yield np.asarray(canvas.buffer_rgba())[..., :3].copy()


def _heat(figure: Figure, axes: Sequence[Axes], deltas: Deltas, size: int) -> None:
    known = [delta for delta in deltas if delta is not None]
    top = max((float(delta.max()) for delta in known), default=0.0) or 1.0
    drawn: Any = None
    for each, delta in zip(axes, deltas, strict=True):
        grid = np.zeros((size, size)) if delta is None else delta.reshape(size, size)
        drawn = each.imshow(grid, cmap="YlOrBr", vmin=0, vmax=top)
    if known:
        bar = figure.colorbar(drawn, ax=list(axes), shrink=0.75, pad=0.02)
        bar.set_label("|delta|, largest over actions", fontsize=8)


def _grid(axes: Axes, context: Context, episode: Episode) -> None:
    wind = context["wind"]
    size = len(wind)
    axes.set(xlim=(-0.5, size - 0.5), ylim=(size - 0.5 + WIND_ROWS, -0.5), xticks=[], yticks=[])
    axes.set_title(episode.title, fontsize=9)
    for side in axes.spines.values():
        side.set_visible(False)
    axes.hlines(size - 0.5, -0.5, size - 0.5, color="black", linewidth=0.8)
    strongest = max((abs(strength) for strength in wind), default=0) or 1
    middle = size + 0.9
    for column, strength in enumerate(wind):
        if strength:
            reach = 0.35 + 0.65 * abs(strength) / strongest
            up = -reach if strength > 0 else reach
            axes.annotate(
                "",
                (column, middle + up),
                (column, middle - up),
                arrowprops={"arrowstyle": "-|>", "color": WIND, "linewidth": 0.9, "mutation_scale": 7},
            )
        axes.text(column, size + 2.3, f"{strength}", ha="center", va="center", fontsize=6, color=WIND)


def _moving(axes: Axes, context: Context) -> tuple[Any, ...]:
    """Return what changes from image to image, in drawing order: path, agent, caption, and the letters on top."""
    halo = [Stroke(linewidth=3.4, foreground="white"), Normal()]
    (path,) = axes.plot([], [], color=PATH, linewidth=1.8, animated=True, path_effects=halo, zorder=3)
    (head,) = axes.plot([], [], "o", color=PATH, markeredgecolor="white", markersize=8, animated=True, zorder=5)
    text = axes.text(0.5, -0.005, "", transform=axes.transAxes, ha="center", va="bottom", fontsize=8, animated=True)
    letters = [
        axes.text(column, row, name, ha="center", va="center", fontweight="bold", animated=True, path_effects=halo)
        for name, (row, column) in (("S", context["start"]), ("G", context["goal"]))
    ]
    return path, head, text, *letters


def _move(axes: Axes, episode: Episode, artists: tuple[Any, ...], step: int, size: int) -> None:
    step = min(step, episode.steps)
    rows, columns = np.divmod(np.array(episode.states[: step + 1]), size)
    path, head, text, *_ = artists
    path.set_data(columns, rows)
    head.set_data(columns[-1:], rows[-1:])
    text.set_text(caption(episode, step))
    for artist in artists:
        axes.draw_artist(artist)


def caption(episode: Episode, step: int) -> str:
    """Return the step, the return so far, and how the episode has ended."""
    step = min(step, episode.steps)
    end = "" if step < episode.steps else (", ended" if episode.terminated else ", time limit")
    return f"step {step}, return {episode.returns[step]:.4g}{end}"
