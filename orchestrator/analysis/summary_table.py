"""The summary table of a sweep, as a person reads it."""

from __future__ import annotations

from collections.abc import Collection

from orchestrator.analysis.groups import Group
from orchestrator.analysis.labels import settings_text, signed, varied
from orchestrator.analysis.statistics import LEVEL, Estimate, TransferRatio
from trainables.plugins.names import short

COLUMNS = (
    "task",
    "agent",
    "source",
    "hyperparameters",
    "seeds",
    "AUC mean (sd)",
    f"transfer ratio [{LEVEL:.0%}]",
    f"difference [{LEVEL:.0%}]",
)


def row(group: Group, hide: Collection[str] = ()) -> tuple[str, ...]:
    """A group's line of the table, under COLUMNS, without the hyperparameters in `hide`."""
    against, own = group.against_base, varied(group.agent, group.task, group.hyperparameters)
    seeds = f"{len(group.seeds)}" + (f", {group.failed} failed" if group.failed else "")
    seeds += f", {group.stopped} stopped early" if group.stopped else ""
    seeds += f", {group.missing} missing" if group.missing else ""
    mean = "-" if group.auc is None else f"{group.auc.value:.2f} ({group.auc_sd:.2f})"
    return (
        short(group.task),
        short(group.agent),
        group.source_label,
        settings_text({name: value for name, value in own.items() if name not in hide}),
        seeds,
        mean,
        ratio_text(against.transfer_ratio) if against else "-",
        estimate_text(against.difference) if against else "-",
    )


def estimate_text(estimate: Estimate) -> str:
    """'+3.2 [1.0, 5.4]'."""
    ends = ""
    if estimate.low is not None and estimate.high is not None:
        ends = f" [{signed(estimate.low, 1)}, {signed(estimate.high, 1)}]"
    return signed(estimate.value, 1) + ends


def ratio_text(ratio: TransferRatio) -> str:
    """'+12% [3, 21]', or 'undefined'."""
    if ratio.value is None:
        return "undefined"
    ends = ""
    if ratio.low is not None and ratio.high is not None:
        ends = f" [{signed(ratio.low * 100)}, {signed(ratio.high * 100)}]"
    return f"{signed(ratio.value * 100)}%{ends}"
