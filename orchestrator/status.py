"""How far the sweeps of a storage folder are, read from their records alone."""

from __future__ import annotations

from collections import Counter
from pathlib import Path
from typing import Any

from orchestrator.lock import driver
from orchestrator.results import Results

KEYS = ("done", "failed", "stopped", "missing")
"""What may have become of a cell."""


def sweeps(storage: Path, name: str | None) -> list[Results]:
    """The sweep called `name`, or all of a storage folder in order of their names."""
    if name is not None:
        return [Results.open(storage, name)]
    return [Results(path.parent.resolve()) for path in sorted(storage.glob("*/sweep.json"))]


def sweep_status(results: Results) -> dict[str, Any]:
    """Counts by stage, the failures with their causes, and the driver that is at it now (None: none is)."""
    stages: dict[str, Counter[str]] = {stage: Counter() for stage in results.plan()}
    failures = []
    for stage, cell, record in results.ended():
        stages[stage]["missing" if record is None else record.status] += 1
        if record is not None and record.status == "failed":
            failures.append(
                {"cell_id": cell.id, "agent": cell.agent, "task": cell.task, "seed": cell.seed, "error": record.error}
            )
    counts = {
        stage: {key: count[key] for key in ("done", "failed", "stopped", "missing")} for stage, count in stages.items()
    }
    return {
        "sweep": results.name,
        "folder": str(results.folder),
        "stages": counts,
        "failures": failures,
        "driver": driver(results.folder),
    }
