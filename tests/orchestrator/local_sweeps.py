"""Small sweeps in this process, and what is on disk of them."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from conftest import SPACE
from rich.console import Console

from orchestrator.execution.settings import Settings
from orchestrator.execution.sweep import run
from orchestrator.results.sweep_folder import Results
from search_spaces.loading import parse
from search_spaces.search_space import SearchSpace

LOCAL = Settings(local=True, workers=1)
POOL = Settings(local=True, workers=2)


def space(**changes: Any) -> SearchSpace:
    return parse("small", SPACE | {"seeds": 1, "agents": {"q_learning": {}}} | changes)


def swept(storage: Path, asked: SearchSpace, settings: Settings = LOCAL) -> tuple[Results, int]:
    """The sweep after another run of it, and how many cells that ran."""
    results = Results.create(storage, "small", asked)
    summary = run(results, settings, Console(quiet=True))
    assert (summary.failed, summary.left) == (0, 0)
    return results, summary.ran


def snapshot(folder: Path) -> dict[str, bytes | None]:
    """Every file of a folder to the byte, and every folder."""
    return {
        str(path.relative_to(folder)): path.read_bytes() if path.is_file() else None
        for path in sorted(folder.rglob("*"))
    }
