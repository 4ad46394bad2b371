"""Cells of a length that is given in seconds, whatever the machine."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

PILOT = 10_000
"""Episodes of the cells that are timed."""


def episodes_of(seconds: float, space: Callable[[int], dict[str, Any]], folder: Path) -> int:
    """How many episodes make a cell of `space(episodes)` last `seconds`. Runs some on Ray, which warms its workers."""
    from rich.console import Console

    from orchestrator.results import Results
    from orchestrator.settings import Settings
    from orchestrator.sweep import run
    from search_spaces import parse

    pilot = None
    for number in range(2):  # the first one pays for imports and compilation
        results = Results.create(folder / f"pilot{number}", "pilot", parse("pilot", space(PILOT)))
        pilot = run(results, Settings(), Console(quiet=True))
    assert pilot is not None
    return max(1, round(PILOT * seconds * pilot.ran / pilot.training_seconds))
