"""The summary table of a sweep, as text and as numbers."""

from __future__ import annotations

import json
from collections.abc import Collection, Sequence
from typing import Any

import pandas as pd

from orchestrator.analysis.groups import Group
from orchestrator.analysis.labels import settings, settings_text
from orchestrator.analysis.metrics import METRICS, shown
from trainables.plugins.names import short

STATISTICS = (*(metric.heading for metric in shown("summary")), "verdict")
COLUMNS = ("task", "agent", "source", "hyperparameters", "seeds", *STATISTICS)


CORRECTED = {"difference_p_holm": "p", "difference_low_all": "low", "difference_high_all": "high"}
"""Number to the field of `Corrected` that it is: the difference among all comparisons of the sweep."""


CONFIRMED = tuple(metric for metric in METRICS if metric.key in ("auc", "transfer_ratio", "difference"))
"""What a table shows of a confirmation, next to the numbers of the seeds that selected the configuration."""


CONFIRMED_COLUMNS = ("unseen seeds", *(f"confirmed {metric.heading}" for metric in CONFIRMED))


def confirmed_texts(found: Group | None) -> tuple[str, ...]:
    """Return what a confirmation says, under CONFIRMED_COLUMNS; dashes for None."""
    if found is None:
        return ("-",) * len(CONFIRMED_COLUMNS)
    return (str(len(found.seeds)), *(metric.text(found.estimates.get(metric.key)) for metric in CONFIRMED))


def text_table(groups: Sequence[Group]) -> pd.DataFrame:
    """Return the table for people: a row per configuration, with its confirmation where there is one."""
    if not any(group.confirmed for group in groups):
        return pd.DataFrame([row(group) for group in groups], columns=list(COLUMNS))
    rows = [(*row(group), *confirmed_texts(group.confirmed)) for group in groups]
    return pd.DataFrame(rows, columns=[*COLUMNS, *CONFIRMED_COLUMNS])


def row(group: Group, hide: Collection[str] = ()) -> tuple[str, ...]:
    """Return a group's row of the table, under COLUMNS, without the hyperparameters in `hide`."""
    own = settings(group)
    seeds = f"{len(group.seeds)}" + (f" x {group.networks} sources" if group.networks > 1 else "")
    seeds += f", {group.failed} failed" if group.failed else ""
    seeds += f", {group.stopped} stopped early" if group.stopped else ""
    seeds += f", {group.missing} missing" if group.missing else ""
    seeds += f"; {group.nothing}" if group.nothing else ""
    return (
        short(group.task),
        short(group.agent),
        group.source_label,
        settings_text({name: value for name, value in own.items() if name not in hide}),
        seeds,
        *(metric.text(group.estimates.get(metric.key)) for metric in shown("summary")),
        group.judged.verdict_text or "-",
    )


def table(groups: Sequence[Group], hide: Collection[str] = ()) -> tuple[tuple[str, ...], list[tuple[str, ...]]]:
    """Return (columns, rows) of several groups, without the statistics that none of them has."""
    rows = [row(group, hide) for group in groups]
    kept = [
        at
        for at, name in enumerate(COLUMNS)
        if name not in STATISTICS or not rows or any(line[at] != "-" for line in rows)
    ]
    return tuple(COLUMNS[at] for at in kept), [tuple(line[at] for at in kept) for line in rows]


def numbers(group: Group) -> dict[str, Any]:
    """Return a group's row of the table of numbers: each metric in full precision, and the verdict."""
    record: dict[str, Any] = {
        "task": group.task,
        "agent": group.agent,
        "source": group.source,
        "source_task": group.source_task,
        "pick": group.pick or None,
        "source_networks": group.networks if group.source == "learned" else None,
        "settings": settings_text(settings(group)),
        "hyperparameters": json.dumps(dict(group.hyperparameters), sort_keys=True),
        "seeds_done": len(group.seeds),
        "seeds_failed": group.failed,
        "seeds_stopped": group.stopped,
        "seeds_missing": group.missing,
        "learned_nothing": group.nothing is not None,
        "tried": group.tried,
        "confirmed": group.confirmed is not None,
        "verdict": group.verdict,
        "holds": group.corrected.holds if group.corrected else None,
        "comparisons": group.corrected.comparisons if group.corrected else None,
        **{name: getattr(group.corrected, field, None) for name, field in CORRECTED.items()},
    }
    for metric in METRICS:
        record |= metric.numbers(group.estimates.get(metric.key))
    return record | (confirmed_numbers(group.confirmed) if group.confirmed else {})


def confirmed_numbers(found: Group) -> dict[str, Any]:
    """Return the numbers of a confirmation, as columns next to those of the seeds that selected the configuration."""
    record: dict[str, Any] = {"confirmed_seeds": len(found.seeds), "confirmed_verdict": found.verdict}
    record["confirmed_holds"] = found.corrected.holds if found.corrected else None
    for metric in METRICS:
        record |= {
            f"confirmed_{name}": value for name, value in metric.numbers(found.estimates.get(metric.key)).items()
        }
    return record


def number_table(groups: Sequence[Group]) -> pd.DataFrame:
    """Return the table of numbers: a row per configuration, a column per number."""
    table = pd.DataFrame([numbers(group) for group in groups])
    floats = [*CORRECTED, *(name for metric in METRICS for name in metric.numbers(None))]
    return table.astype(dict.fromkeys(floats, "float64")) if len(table) else table
