"""What people look at: figures drawn from the results table alone."""

from __future__ import annotations

from pathlib import Path

from orchestrator.results import Results

__all__ = ["draw"]


def draw(results: Results) -> list[Path]:
    """Draw every figure that the sweep has the cells for, as PNG and SVG in its folder `figures`; the files."""
    from dashboards import advice, curves, reuse

    return [path for figure in (reuse.draw, curves.draw, advice.draw) for path in figure(results)]
