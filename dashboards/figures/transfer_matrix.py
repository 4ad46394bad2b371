"""Source x target: the transfer effect of every agent, negative transfer marked."""

from __future__ import annotations

from collections.abc import Sequence

from dashboards.figure_model import Absent, Matrix
from dashboards.labels import SOURCES, in_order, minus, targets
from orchestrator.analysis.findings import Findings
from orchestrator.analysis.groups import Group
from orchestrator.analysis.metrics import signed
from orchestrator.planning.arms import Key

NAME, TITLE = "matrix", "Transfer effect, source by target"

MARKS = {"helped": "▲ ", "hurt": "▼ "}
HOLLOW = {"helped": "△ ", "hurt": "▽ "}
"""Marks of what does not hold after the correction for all comparisons of the sweep."""


def chart(findings: Findings) -> Matrix | Absent:
    """Return the matrix: a row per source, kind, pick and agent, a column per target; best configurations only."""
    best = {group.key: group.judged for group in in_order(findings.best) if group.judged.against_base}
    columns = [target for target in targets(findings) if any(key.task == target for key in best)]
    if not columns:
        reason = "No configuration with transfer has every seed done in common with the agent without transfer."
        return Absent(NAME, TITLE, reason)
    order = list(SOURCES)
    rows = sorted(
        dict.fromkeys(key._replace(task="") for key in best), key=lambda row: (row.source_task, order.index(row.kind))
    )
    grid = [[best.get(row._replace(task=target)) for target in columns] for row in rows]
    caption = (
        "Transfer ratio of each agent's best configuration. ▲ transfer helped, ▼ it hurt (negative transfer): the "
    )
    caption += "95 % interval of the paired difference in AUC lies on one side of 0. Hollow: not after Holm's "
    caption += "correction for all comparisons of the sweep. Without a mark it is undecided."
    if any(group.confirmed for group in findings.best):
        caption += " What was confirmed shows the ratio of the unseen seeds."
    return Matrix(
        NAME,
        TITLE,
        caption,
        tuple((row.source_task, _kind(row, rows), row.agent) for row in rows),
        tuple(columns),
        tuple(tuple(_text(group) for group in line) for line in grid),
        tuple(tuple((group.verdict or "") if group else "" for group in line) for line in grid),
    )


def _kind(row: Key, rows: Sequence[Key]) -> str:
    """Return the kind of source, with the pick where another row differs in nothing else."""
    rivals = [other for other in rows if other._replace(pick="") == row._replace(pick="")]
    return row.kind if len(rivals) == 1 else f"{row.kind} ({row.pick})"


def _ratio(group: Group | None) -> float | None:
    return group.against_base.transfer_ratio.value if group and group.against_base else None


def _text(group: Group | None) -> str:
    if group is None:
        return "–"
    ratio = _ratio(group)
    holds = group.corrected is not None and group.corrected.holds
    mark = (MARKS if holds else HOLLOW).get(group.verdict or "", "")
    return mark + ("undefined" if ratio is None else minus(f"{signed(100 * ratio)} %"))
