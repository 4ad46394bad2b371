"""The status of the sweeps in a storage folder, from their records alone."""

from __future__ import annotations

from collections import Counter
from pathlib import Path
from typing import Any

from orchestrator.results import progress
from orchestrator.results.lock import driver
from orchestrator.results.sweep_folder import Results
from trainables.errors import InputError

KEYS = ("done", "failed", "stopped", "missing")
"""The states of a cell."""


def sweeps(storage: Path, name: str | None) -> list[Results]:
    """Return the sweep called `name`, or all sweeps of a storage folder, sorted by name."""
    if name is not None:
        return [Results.open(storage, name)]
    return [Results(path.parent.resolve()) for path in sorted(storage.glob("*/sweep.json"))]


def sweep_status(results: Results) -> dict[str, Any]:
    """Return counts by stage, failures with their causes, the driver (or None) and its progress, and any damage."""
    who = driver(results.folder)
    damage = results.damage(running=who is not None)
    try:
        results.meta()
        plan = results.plan()
    except InputError as error:
        plan, damage = {}, [*damage, str(error)]
    stages: dict[str, Counter[str]] = {stage: Counter() for stage in plan}
    failures = []
    for stage, cell, record in results.planned_heads(plan):
        stages[stage]["missing" if record is None else record.status] += 1
        if record is not None and record.status == "failed":
            failures.append(
                {"cell_id": cell.id, "agent": cell.agent, "task": cell.task, "seed": cell.seed, "error": record.error}
            )
    now = progress.read(results.folder) if who else None
    return {
        "sweep": results.name,
        "folder": str(results.folder),
        "stages": {stage: {key: count[key] for key in KEYS} for stage, count in stages.items()},
        "failures": failures,
        "driver": who,
        "now": now.line() if now else None,
        "damage": damage,
    }
