"""One look for all figures: colour-blind safe (Okabe and Ito), readable in print."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import matplotlib
from matplotlib.figure import Figure

COLOURS = {
    "q_learning": "#4d4d4d",
    "policy_reuse": "#e69f00",
    "ppr": "#0072b2",
    "delta_gate": "#d55e00",
    "confidence_gate": "#009e73",
    "q_warm_start": "#cc79a7",
    "dqn": "#4d4d4d",
    "es": "#0072b2",
    "delta_es": "#d55e00",
    "dpba": "#56b4e9",
    "delta_dpba": "#cc79a7",
}
"""Each agent's colour, the same everywhere; a deep agent has that of its tabular kin, which it never meets."""

LINES = {
    "dqn": "--",
    "es": "-.",
    "dpba": ":",
    "q_learning": "--",
    "policy_reuse": ":",
    "ppr": "-.",
    "confidence_gate": (0, (6, 2)),
    "q_warm_start": (0, (5, 1, 1, 1, 1, 1)),
}
"""Each agent's line style, so that a print without colour can be read; the others are solid."""

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


def new_figure(width: float, height: float) -> Figure:
    """An empty figure, width and height in inches, that needs no screen."""
    matplotlib.rcParams.update(SETTINGS)
    return Figure(figsize=(width, height), layout="constrained")


def save(figure: Figure, folder: Path, name: str) -> list[Path]:
    """Write PNG and SVG, the same bytes for the same figure; the two files."""
    folder.mkdir(exist_ok=True)
    paths = [folder / f"{name}.png", folder / f"{name}.svg"]
    figure.savefig(paths[0], dpi=150, metadata={"Software": None})
    figure.savefig(paths[1], metadata={"Date": None})
    return paths
