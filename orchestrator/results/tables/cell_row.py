"""The rows of the cells table."""

from __future__ import annotations

import json
from typing import Any

from orchestrator.planning.arms import PLAIN, Label, configuration_id
from orchestrator.results.records.record import Head
from trainables.cell import Cell


def cell_row(stage: str, cell: Cell, head: Head | None, label: Label = PLAIN) -> dict[str, Any]:
    """Return a cell's row of the cells table. A cell that is not done has no AUC: it is counted, never averaged."""
    source = cell.sources[0] if cell.sources else None
    row: dict[str, Any] = {
        "cell_id": cell.id,
        "stage": stage,
        "status": "missing" if head is None else head.status,
        "agent": cell.agent,
        "task": cell.task,
        "source_task": source.task if source else None,
        "source": source.kind if source else "none",
        "source_cell": source.cell_id if source else None,
        "pick": label.pick or None,
        "baseline_for": label.baseline_for or None,
        "seed": cell.seed,
        "group": configuration_id(cell, label),
        "auc": None,
        "error": head.error if head else None,
        "seconds": head.seconds if head else None,
        "hyperparameters": json.dumps(cell.hyperparameters, sort_keys=True),
    }
    return row | (head.summary if head else {})
