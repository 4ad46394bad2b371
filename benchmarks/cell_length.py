"""Cells of a given length in seconds, on any machine."""

from __future__ import annotations

import statistics
from collections.abc import Callable
from pathlib import Path
from typing import Any

PILOT = 10_000
"""Episodes of the first timed cells."""


def episodes_of(seconds: float, space: Callable[[int], dict[str, Any]], folder: Path) -> int:
    """Return the episodes of a cell of `space(episodes)` that lasts `seconds`; runs some on Ray, which warms it up."""
    from rich.console import Console

    from orchestrator.execution.settings import Settings
    from orchestrator.execution.sweep import run
    from orchestrator.results.sweep_folder import Results
    from search_spaces.loading import parse

    episodes = PILOT
    for number in range(2):  # the fixed part of a cell makes the first result inaccurate
        results = Results.create(folder / f"pilot{number}", "pilot", parse("pilot", space(episodes)))
        run(results, Settings(), Console(quiet=True))
        typical = statistics.median(head.seconds for head in results.heads().values())
        episodes = max(1, round(episodes * seconds / typical))
    return episodes
