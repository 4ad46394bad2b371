"""The tags, metrics and curves of MLflow runs, with few enough points for a browser."""

from __future__ import annotations

import math
import re
from collections import Counter
from collections.abc import Sequence
from typing import Any

from orchestrator.analysis.groups import Group
from orchestrator.analysis.labels import run_name
from orchestrator.analysis.metrics import METRICS
from orchestrator.analysis.tables.summary_table import CONFIRMED, CORRECTED, confirmed_numbers, confirmed_texts
from orchestrator.results.records.record import Head

CELL_METRICS = (
    *("auc", "training_auc", "initial_return", "final_return", "asymptotic"),
    *("seconds", "steps", "steps_per_second"),
)
"""Columns of the cells table that are metrics of a cell's run."""

RETURN_POINTS, STATISTIC_POINTS = 51, 17
"""Points per curve in MLflow, for greedy returns and for other columns; the results table has all."""


def thinned(metric: str, curve: Sequence[tuple[Any, Any]]) -> list[tuple[Any, Any]]:
    """Return the curve reduced to that number of evenly spaced points, first and last included."""
    points = RETURN_POINTS if metric.startswith("greedy_return") else STATISTIC_POINTS
    if len(curve) <= points:
        return list(curve)
    last = len(curve) - 1
    return [curve[round(i * last / (points - 1))] for i in range(points)]


def cell_tags(stage: str, head: Head) -> dict[str, str]:
    """Return the tags of a cell's run: the cell and its provenance."""
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
    """Return (metrics, tags) of an aggregate; an undefined number is a tag, never a metric."""
    counts = {"failed": group.failed, "stopped": group.stopped, "missing": group.missing}
    metrics: dict[str, float] = {"seeds": len(group.seeds), **counts}
    metrics |= {"source_networks": group.networks} if group.networks > 1 else {}
    tags = {"agent": group.agent, "task": group.task, "source": group.source, "stage": group.stage}
    tags |= {"source_task": group.source_task} if group.source_task else {}
    tags |= {"pick": group.pick} if group.pick else {}
    for metric in METRICS:
        found = metric.numbers(group.estimates.get(metric.key))
        metrics |= {name: value for name, value in found.items() if value is not None}
    if group.confirmed:
        found = confirmed_numbers(group.confirmed)
        metrics |= {
            name: value
            for name, value in found.items()
            if isinstance(value, float | int) and not isinstance(value, bool)
        }
        texts = confirmed_texts(group.confirmed)
        names = ("unseen seeds", *(f"confirmed {TEXTS[metric.key]}" for metric in CONFIRMED))
        tags |= {**dict(zip(names, texts, strict=True)), "confirmed verdict": group.confirmed.verdict_text or "-"}
    if group.corrected:
        metrics |= {name: getattr(group.corrected, field) for name, field in CORRECTED.items()}
        metrics["comparisons"] = group.corrected.comparisons
    if group.tried > 1:
        tags["chosen"] = f"best of {group.tried}, {'confirmed' if group.confirmed else 'not confirmed'} on unseen seeds"
    tags |= {"learned": group.nothing} if group.nothing else {}
    tags |= {TEXTS[name]: text for name, text in _texts(group).items()}
    if group.against_base is not None and group.against_base.transfer_ratio.undefined:
        tags["transfer_ratio"] = f"undefined: {group.against_base.transfer_ratio.undefined}"
    return metrics, tags


TEXTS = {"auc": "AUC", "transfer_ratio": "transfer_ratio", "difference": "difference"}
TEXTS |= {"verdict": "verdict", "holds": "holds"}
"""Metric, verdict, or whether that holds after Holm's correction, to the tag with its rounded text: the columns of the
leaderboard."""


def _texts(group: Group) -> dict[str, str]:
    """Return the most important numbers as rounded text with their intervals."""
    found = {metric.key: metric.text(group.estimates.get(metric.key)) for metric in METRICS if metric.key in TEXTS}
    holds = (
        "-" if group.corrected is None or group.verdict in (None, "undecided") else str(group.corrected.holds).lower()
    )
    return found | {"verdict": group.verdict or ("baseline" if group.source == "none" else "-"), "holds": holds}


def places(groups: Sequence[Group]) -> dict[str, str]:
    """Return group id to '02.01': the number of its task in the sweep, and its rank by AUC on that task.

    Only for the transfer stage. AUCs of different tasks are never ranked together.
    """
    shown = [group for group in groups if group.stage == "transfer"]
    found: dict[str, str] = {}
    for number, task in enumerate(dict.fromkeys(group.task for group in shown), 1):
        here = sorted((g for g in shown if g.task == task), key=lambda g: -g.auc.value if g.auc else math.inf)
        found |= {group.id: f"{number:02d}.{rank:02d}" for rank, group in enumerate(here, 1)}
    return found


def sweep_metrics(best: Sequence[Group]) -> dict[str, float]:
    """Return the metrics of the sweep's own run: how often transfer helped, and the best AUC on each target.

    Of what was confirmed, the figures of the unseen seeds.
    """
    counts = Counter(group.judged.verdict for group in best if group.judged.verdict)
    metrics: dict[str, float] = {f"transfer_{name}": counts[name] for name in ("helped", "hurt", "undecided")}
    for group in (group.judged for group in best if group.stage == "transfer"):
        if group.auc:
            name = re.sub(r"[^\w./: -]+", " ", f"best_auc {run_name(group.task)}", flags=re.ASCII)[:250]
            metrics[name] = max(metrics.get(name, -math.inf), float(f"{group.auc.value:.{DIGITS}g}"))
    return metrics


DIGITS = 6
"""Of the best AUCs in the sweep's run; the aggregates and the tables have full precision."""
