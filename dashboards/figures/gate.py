"""The gate, or the advice, over training: when the source is followed, and what delta says meanwhile."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass

from dashboards.figure_model import Absent, Chart, Level, Panel
from dashboards.figures.evaluation_curves import Bands, line
from dashboards.labels import count, heading, in_order, kinds, listed, targets
from orchestrator.analysis.curves import curve_bands
from orchestrator.analysis.findings import Findings
from orchestrator.analysis.groups import Group

NAME, TITLE = "gate", "Gate and advice over training"


@dataclass(frozen=True)
class Quantity:
    """One statistic of the evaluation points."""

    column: str
    title: str
    axis: str
    share: bool = False
    """Between 0 and 1."""


QUANTITIES = (
    Quantity("gate_open_share", "share of steps with the gate open", "share of steps", True),
    Quantity("source_action_share", "share of steps with the source's action", "share of steps", True),
    Quantity("kappa", "kappa, the weight of advice", "kappa", True),
    Quantity("advice_factor", "advice factor, kappa exp(−max |delta|)", "advice factor", True),
    Quantity("max_abs_delta", "max |delta|", "max |delta|"),
    Quantity("delta_p90", "90 % quantile of max |delta|", "max |delta|"),
)


def chart(findings: Findings) -> Chart | Absent:
    """A panel per target, kind of source and quantity, of each agent's best configuration."""
    shown = in_order(group for group in findings.best if group.source != "none")
    columns = [quantity.column for quantity in QUANTITIES]
    bands = curve_bands(findings.points, findings.cells, [group.id for group in shown], columns)
    panels = [
        panel
        for target in targets(findings)
        for source in kinds(shown)
        for quantity in QUANTITIES
        if (panel := _panel(target, source, quantity, shown, bands, findings.common)) is not None
    ]
    if not panels:
        reason = "No agent with a source has every seed done, so there is no gate and no advice to show."
        return Absent(NAME, TITLE, reason)
    caption = (
        "Mean and 95 % interval over seeds, each agent's best configuration. Level lines: the threshold of the gate."
    )
    alt = f"{count(len(panels), 'panel')} of gate, advice and delta over training."
    return Chart(NAME, TITLE, caption, alt, tuple(panels), columns=3)


def _panel(
    target: str,
    source: str,
    quantity: Quantity,
    shown: Sequence[Group],
    bands: Bands,
    hide: Collection[str],
) -> Panel | None:
    here = [group for group in shown if (group.task, group.source) == (target, source)]
    here = [group for group in here if len(bands[group.id, quantity.column])]
    if not here:
        return None
    series = tuple(line(group, bands[group.id, quantity.column], hide) for group in here)
    levels = []
    if quantity.column == "max_abs_delta":
        gated = [group for group in here if "threshold" in group.hyperparameters]
        levels = _thresholds(gated)
    reach = (-0.04, 1.04) if quantity.share else None
    title = f"{heading(target, source)}: {quantity.title}"
    return Panel(title, "training episode", quantity.axis, series, target, tuple(levels), y_range=reach)


def _thresholds(gated: Sequence[Group]) -> list[Level]:
    """One line per threshold, named after every agent that has it."""
    by_value: dict[float, list[str]] = {}
    for group in gated:
        by_value.setdefault(float(group.hyperparameters["threshold"]), []).append(group.agent)
    return [Level(value, f"threshold of {listed(names)}", names[0]) for value, names in by_value.items()]
