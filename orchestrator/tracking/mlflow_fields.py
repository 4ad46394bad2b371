"""What an MLflow run of a cell or a group holds: tags, metrics, and curves thin enough for a browser."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from orchestrator.analysis.groups import Group
from orchestrator.analysis.metrics import METRICS
from orchestrator.results.record import Head

CELL_METRICS = (
    *("auc", "training_auc", "initial_return", "final_return", "asymptotic"),
    *("seconds", "steps", "steps_per_second"),
)
"""Columns of the cells table that a cell's run has as metrics."""

CURVE_POINTS = 51
"""Points of a curve that MLflow gets, evenly spaced, first and last included; the results table has them all."""


def thinned(curve: Sequence[tuple[Any, Any]]) -> list[tuple[Any, Any]]:
    """At most CURVE_POINTS of a curve's points, evenly spaced, first and last included."""
    if len(curve) <= CURVE_POINTS:
        return list(curve)
    last = len(curve) - 1
    return [curve[round(i * last / (CURVE_POINTS - 1))] for i in range(CURVE_POINTS)]


def cell_tags(stage: str, head: Head) -> dict[str, str]:
    """The tags of a cell's run: what it was, and what it was made with."""
    cell = head.cell
    tags = {"agent": cell.agent, "task": cell.task, "seed": str(cell.seed), "stage": stage, "status": head.status}
    source = cell.sources[0] if cell.sources else None
    tags |= {"source": source.kind if source else "none", "of_group": cell.group, "commit": head.commit}
    if source is not None:
        tags |= {"source_task": source.task, "source_cell": source.cell_id or "exact"}
    if head.error:
        tags["error"] = head.error[:5000]
    return tags | {f"version.{name}": version for name, version in head.versions.items()}


def group_figures(group: Group) -> tuple[dict[str, float], dict[str, str]]:
    """(metrics, tags) of an aggregate; what is undefined is said in a tag, never logged as a number."""
    counts = {"failed": group.failed, "stopped": group.stopped, "missing": group.missing}
    metrics: dict[str, float] = {"seeds": len(group.seeds), **counts}
    tags = {"agent": group.agent, "task": group.task, "source": group.source, "stage": group.stage}
    tags |= {"source_task": group.source_task} if group.source_task else {}
    tags |= {"pick": group.pick} if group.pick else {}
    for metric in METRICS:
        found = metric.numbers(group.estimates.get(metric.key))
        metrics |= {name: value for name, value in found.items() if value is not None}
    if group.against_base is not None and group.against_base.transfer_ratio.undefined:
        tags["transfer_ratio"] = f"undefined: {group.against_base.transfer_ratio.undefined}"
    return metrics, tags
