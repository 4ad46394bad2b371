"""The report: one self-contained HTML file, from the results table alone."""

from __future__ import annotations

import logging
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from dashboards.figure_model import Absent, Figure, Matrix
from dashboards.figures import (
    advice_fraction,
    delta_effect,
    evaluation_curves,
    forest,
    gate,
    importance,
    over_tasks,
    sensitivity,
    transfer_matrix,
)
from dashboards.labels import SOURCES, listed, minus, targets
from dashboards.renderers import plotly_renderer
from dashboards.report import comparisons
from dashboards.report.origin import origin
from dashboards.report.page import Parts, render
from dashboards.report.tables import Datum, Table, table_1, text_csv, unfinished
from dashboards.report.verdict import verdict
from orchestrator.analysis.contrasts.decisions import LEAD as DECISIONS
from orchestrator.analysis.findings import Findings
from orchestrator.analysis.groups import Group
from orchestrator.analysis.labels import settings_text
from orchestrator.analysis.selection import optimism
from orchestrator.analysis.tables.paper_table1 import same_row
from orchestrator.analysis.tables.paper_table1 import table_1 as paper_row

log = logging.getLogger("deltatune.report")

MAX_FACETS = 4
"""Panels of a chart shown together for several targets; with more, one target is shown at a time."""


@dataclass(frozen=True)
class Section:
    """One section of the report: a text, then tables and figures in order."""

    id: str
    title: str
    lead: str
    content: tuple[Table | Figure, ...]


def figures(findings: Findings, missing: list[str] | None = None) -> list[Figure]:
    """Return every figure, as Absent where the sweep has no data for it.

    A figure that raises is Absent too, and `missing` gets a sentence on it; the others are drawn all the same.
    """
    charts = [over_tasks, transfer_matrix, evaluation_curves, delta_effect, gate, forest, importance]
    charts += [sensitivity, advice_fraction]
    wanted: list[tuple[str, str, Callable[[Findings], Figure]]]
    wanted = [(module.NAME, module.TITLE, module.chart) for module in charts]
    profile = over_tasks.PROFILE, over_tasks.PROFILE_TITLE, over_tasks.performance_profile
    wanted.insert(1, profile)
    drawn = []
    for name, title, chart in wanted:
        try:
            drawn.append(chart(findings))
        except Exception as error:
            drawn.append(_failed(name, title, error, missing))
    return drawn


def _failed(name: str, title: str, error: Exception, missing: list[str] | None) -> Absent:
    """Return the placeholder of a figure that could not be drawn."""
    log.error("the figure %s could not be drawn", name, exc_info=error)
    if missing is not None:
        missing.append(f"{name} ({type(error).__name__}: {error})")
    return Absent(name, title, f"It could not be drawn: {type(error).__name__}: {error}.")


def sections(findings: Findings, drawn: list[Figure]) -> tuple[list[Section], list[Absent]]:
    """Return the sections that have something to show, in their order, and what is not shown with its reason."""
    of = {figure.name: figure for figure in drawn}
    planned = [
        Section("curves", "Evaluation curves", "", (of[evaluation_curves.NAME],)),
        Section("results", _results_title(findings), _table_lead(findings), _tables(findings)),
        Section("decisions", "Sequential test over seeds", DECISIONS, comparisons.decisions(findings)),
        Section("contrasts", "Contrasts", comparisons.LEAD, comparisons.contrasts(findings)),
        Section("tasks", "Over all tasks", "", comparisons.over_tasks(findings, of)),
        Section("variance", "Between sources and seeds", *comparisons.variance(findings)),
        Section("matrix", "Source by target", "", (of[transfer_matrix.NAME],)),
        Section("forest", "Transfer ratios", "", (of[forest.NAME],)),
        Section("delta", "Delta against transfer effect", _EFFECT, (of[delta_effect.NAME], *_correlations(findings))),
        Section("gate", "Gate and advice over time", "", (of[gate.NAME],)),
        Section("hyperparameters", "Hyperparameters", "", _hyperparameters(of)),
        Section("cells", "Failed and missing cells", "", _cells(findings)),
    ]
    absent = [item for section in planned for item in section.content if isinstance(item, Absent)]
    left = [_without_absent(section) for section in planned]
    best = bool(findings.best)
    return [one for one in left if one.content or (one.id == "hyperparameters" and best)], absent


def _hyperparameters(of: dict[str, Figure]) -> tuple[Figure, ...]:
    return of[importance.NAME], of[sensitivity.NAME], of[advice_fraction.NAME]


def _without_absent(section: Section) -> Section:
    return replace(section, content=tuple(item for item in section.content if not isinstance(item, Absent)))


def _results_title(findings: Findings) -> str:
    return "Results (Table 1)" if any(same_row(group) for group in findings.best) else "Results"


_EFFECT = (
    "If delta predicts when to transfer, its size falls as the transfer ratio rises: a rank correlation near −1. "
    "The interval is a bootstrap over targets; with few targets it is wide, as it should be."
)


def _table_lead(findings: Findings) -> str:
    if not findings.best:
        return ""
    text = "The best configuration of each agent by mean AUC over seeds, compared with its baseline without transfer, "
    text += "paired by seed. AUC is the mean of the greedy evaluation curve."
    if any(group.judged.verdict in ("helped", "hurt") for group in findings.best):
        text += " A hollow mark does not hold after Holm's correction for all comparisons of the sweep."
    unseen = sorted({len(group.confirmed.seeds) for group in findings.best if group.confirmed})
    if unseen:
        text += (
            f" Confirmed: the same configurations on {listed([str(number) for number in unseen])} unseen seeds, which "
        )
        text += "had no part in selecting them. They are the figures to report; verdicts follow them."
    text += f" {said}" if (said := optimism(findings.best)) else ""
    if any(group.networks > 1 for group in findings.groups):
        text += " Source networks are crossed with seeds, and intervals of means and differences take both for random."
    elif any(group.source == "learned" and group.sources == 1 and len(group.seeds) > 1 for group in findings.best):
        text += " All seeds of an agent learned from one source network, of which every result is one draw."
    text += f" All with {settings_text(findings.common)}." if findings.common else ""
    ours = [group for group in findings.best if paper_row(group)]
    if ours and not any(same_row(group) for group in ours):
        text += " The paper's numbers are left out, since no row has its settings."
    return text


def _tables(findings: Findings) -> tuple[Table | Figure, ...]:
    if not findings.best:
        reason = "No configuration has every seed done yet, so there is nothing to select or to compare."
        return (Absent("results", "Results", reason),)
    caption = "Best configuration of each agent"
    first = table_1(findings, findings.best, "best", caption)
    if len(findings.groups) == len(findings.best):
        return (first,)
    return first, table_1(findings, findings.groups, "all", f"All {len(findings.groups)} configurations", folded=True)


def _correlations(findings: Findings) -> tuple[Table | Figure, ...]:
    found = delta_effect.correlations(delta_effect.pairs(findings))
    if found and all(one.rho is None for one in found):
        most = max(one.targets for one in found)
        reason = f"A rank correlation needs three different targets; no agent has more than {most} here."
        return (Absent("rank_correlation", "Rank correlation", reason),)
    rows, records = [], []
    for one in found:
        rho = one.rho
        text = "undefined (needs three different targets)" if rho is None else f"{rho.value:+.2f}"
        text += "" if rho is None or rho.low is None else f" [{rho.low:+.2f}, {rho.high:+.2f}]"
        source = SOURCES.get(one.source, one.source)
        name, number = Datum(one.agent, one.agent, agent=one.agent), Datum(str(one.targets), one.targets)
        rows.append((name, Datum(source, source), number, Datum(minus(text), rho.value if rho else None)))
        ends = (rho.value, rho.low, rho.high) if rho else (None,) * 3
        record: dict[str, Any] = {"agent": one.agent, "source": one.source, "targets": one.targets}
        records.append(record | dict(zip(("rho", "rho_low", "rho_high"), ends, strict=True)))
    columns = (("agent", False), ("source", False), ("targets", True), ("Spearman's rho [95%]", True))
    caption = "Rank correlation of delta with the transfer ratio"
    return (Table("rank_correlation", caption, columns, tuple(rows), text_csv(records)),) if rows else ()


def _cells(findings: Findings) -> tuple[Table, ...]:
    table = unfinished(findings.each_cell)
    return () if table is None else (table,)


def winners(findings: Findings) -> list[Group]:
    """Return the best configuration over all agents on each target."""
    best = []
    for target in targets(findings):
        here = [group for group in findings.best if group.task == target and group.judged.auc]
        if here:
            best.append(max(here, key=lambda group: group.judged.auc.value if group.judged.auc else 0.0))
    return best


def block(
    item: Table | Figure, specs: list[plotly_renderer.Spec], first_target: str, missing: list[str] | None = None
) -> dict[str, Any]:
    """Return what the template needs for one table or figure; the panels' specs are added to `specs`."""
    if isinstance(item, Table):
        return {"kind": "table", "table": item}
    if isinstance(item, Absent):
        return {"kind": "absent", "figure": item}
    if isinstance(item, Matrix):
        return {"kind": "matrix", "figure": item, "lines": _lines(item)}
    first = len(specs)
    try:
        specs.extend(plotly_renderer.specs(item))
    except Exception as error:
        del specs[first:]
        return {"kind": "absent", "figure": _failed(item.name, item.title, error, missing)}
    own = list(enumerate(specs[first:], first))
    names = list(dict.fromkeys(spec["target"] for _, spec in own))
    choose = names if len(own) > MAX_FACETS and len(names) > 1 else []
    shown = {"targets": choose, "chosen": first_target if first_target in choose else next(iter(choose), "")}
    return {"kind": "chart", "figure": item, "panels": own, "agents": plotly_renderer.agents(item), **shown}


def _lines(item: Matrix) -> list[tuple[tuple[str, str, str], list[tuple[str, str]]]]:
    return [
        (row, list(zip(texts, verdicts, strict=True)))
        for row, texts, verdicts in zip(item.rows, item.texts, item.verdicts, strict=True)
    ]


def write(findings: Findings, drawn: list[Figure], path: Path, missing: list[str] | None = None) -> Path:
    """Write the report; the same findings give the same bytes."""
    specs: list[plotly_renderer.Spec] = []
    shown, absent = sections(findings, drawn)
    best = winners(findings)
    said = verdict(findings, best)
    first = said.directions[0].headlines[0].task if said.directions else ""
    content = [
        {"section": section, "blocks": [block(item, specs, first, missing) for item in section.content]}
        for section in shown
    ]
    render(path, findings, Parts(said, content, specs, absent, origin(findings), best))
    return path
