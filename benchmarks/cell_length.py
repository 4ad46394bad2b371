"""Cells of a length that is given in seconds, whatever the machine."""

from __future__ import annotations

import statistics
from collections.abc import Callable
from pathlib import Path
from typing import Any

PILOT = 10_000
"""Episodes of the first cells that are timed."""


def episodes_of(seconds: float, space: Callable[[int], dict[str, Any]], folder: Path) -> int:
    """How many episodes make a cell of `space(episodes)` last `seconds`. Runs some on Ray, which warms its workers."""
    from rich.console import Console

    from orchestrator.execution.settings import Settings
    from orchestrator.execution.sweep import run
    from orchestrator.results.sweep_folder import Results
    from search_spaces.loading import parse

    episodes = PILOT
    for number in range(2):  # a cell's fixed part makes the first answer a guess
        results = Results.create(folder / f"pilot{number}", "pilot", parse("pilot", space(episodes)))
        run(results, Settings(), Console(quiet=True))
        typical = statistics.median(head.seconds for head in results.heads().values())
        episodes = max(1, round(episodes * seconds / typical))
    return episodes
