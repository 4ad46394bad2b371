"""The tables of the report: texts, sort keys, and the same numbers in full precision as CSV."""

from __future__ import annotations

import csv
import io
from collections.abc import Collection, Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import pandas as pd

from dashboards.labels import in_order, minus, settings
from orchestrator.analysis.findings import Findings
from orchestrator.analysis.groups import Group
from orchestrator.analysis.metrics import TRANSFER_RATIO, Metric, present
from orchestrator.analysis.tables.paper_table1 import same_row
from orchestrator.analysis.tables.summary_table import CONFIRMED, CONFIRMED_COLUMNS, numbers

MAX_FAILURES = 300
"""Failed cells listed in the page; the CSV has them all."""

CAUSES = {
    "missing": "not run, or its sweep was interrupted",
    "stopped": "stopped early by the scheduler: its curve is shorter, so its AUC is compared with no other",
}


@dataclass(frozen=True)
class Datum:
    """One cell of a table."""

    text: str
    sort: float | str | None = None
    """The sort key; None: at the end."""
    agent: str = ""
    """The agent whose swatch precedes the text; empty: none."""
    mark: str = ""
    """helped or hurt: green or red, with a symbol for colour-blind readers; with a ? where the correction undoes it."""
    code: bool = False


@dataclass(frozen=True)
class Table:
    """A table that can be sorted and downloaded."""

    id: str
    caption: str
    columns: tuple[tuple[str, bool], ...]
    """(title, whether the column is numeric)."""
    rows: tuple[tuple[Datum, ...], ...]
    csv: str
    folded: bool = False
    """Shown on demand."""


def table_1(findings: Findings, groups: Sequence[Group], name: str, caption: str, folded: bool = False) -> Table:
    """Return configurations with AUC, transfer ratio, difference, P(improvement), and the paper's numbers if any."""
    place = {task: number for number, task in enumerate(dict.fromkeys(group.task for group in findings.groups))}
    shown = sorted(in_order(groups), key=lambda group: place[group.task])
    paper = any(same_row(group) for group in shown)
    columns = [("task", False), ("agent", False), ("source", False), ("settings", False), ("seeds", True)]
    metrics = present("report", shown)
    columns += [(metric.heading, True) for metric in metrics]
    confirmed = any(group.confirmed for group in shown)
    columns += [(name, True) for name in CONFIRMED_COLUMNS] if confirmed else []
    columns += [("the paper's", True)] if paper else []
    rows = tuple(
        _row(group, findings.common, metrics)
        + (_confirmed(group.confirmed) if confirmed else ())
        + ((_paper(group),) if paper else ())
        for group in shown
    )
    return Table(name, caption, tuple(columns), rows, text_csv(records(shown)), folded)


def _row(group: Group, hide: Collection[str], metrics: Sequence[Metric]) -> tuple[Datum, ...]:
    short = group.failed + group.missing + group.stopped
    seeds = f"{len(group.seeds)}" + (f" × {group.networks} sources" if group.networks > 1 else "")
    seeds += (
        f", {short} cells short" if short and group.networks > 1 else f" of {len(group.seeds) + short}" if short else ""
    )
    seeds += f"; {group.nothing}" if group.nothing else ""
    return (
        Datum(group.task, group.task),
        Datum(group.agent, group.agent, agent=group.agent),
        Datum("–" if group.source_label == "none" else group.source_label, group.source),
        Datum(settings(group, hide) or "–", settings(group, hide)),
        Datum(seeds, len(group.seeds)),
        *(datum(metric, group) for metric in metrics),
    )


def datum(metric: Metric, group: Group) -> Datum:
    """Return one metric of a group; the transfer ratio has the mark of its verdict."""
    estimate = group.estimates.get(metric.key)
    holds = group.corrected is not None and group.corrected.holds
    symbol = mark(group.verdict, holds) if metric is TRANSFER_RATIO else ""
    return Datum(minus(metric.text(estimate, missing="–")), estimate.value if estimate else None, mark=symbol)


def mark(verdict: str | None, holds: bool) -> str:
    """Return the mark of a verdict: with a question mark where it does not hold after the correction."""
    symbol = {"helped": "helped", "better": "helped", "hurt": "hurt", "worse": "hurt"}.get(verdict or "", "")
    return symbol if holds or not symbol else f"{symbol}?"


def _confirmed(found: Group | None) -> tuple[Datum, ...]:
    """Return what the unseen seeds say of a configuration; the transfer ratio has the mark of that verdict."""
    if found is None:
        return (Datum("–"),) * len(CONFIRMED_COLUMNS)
    return Datum(str(len(found.seeds)), len(found.seeds)), *(datum(metric, found) for metric in CONFIRMED)


def _paper(group: Group) -> Datum:
    row = same_row(group)
    return Datum(minus(str(row)), row.auc) if row else Datum("–")


def records(groups: Iterable[Group]) -> list[dict[str, Any]]:
    """Return groups as rows of a CSV."""
    return [_record(group) for group in groups]


def _record(group: Group) -> dict[str, Any]:
    """Return a group's row of the CSV: each number in a column and in full precision, the paper's included."""
    paper = same_row(group)
    record = numbers(group) | {"paper_auc": paper.auc if paper else None, "paper_sd": paper.sd if paper else None}
    return record | {"paper_transfer_ratio_percent": paper.transfer_ratio if paper else None}


def text_csv(records: Sequence[dict[str, Any]]) -> str:
    """Return records as CSV; text that a spreadsheet would read as a formula gets a leading apostrophe."""
    if not records:
        return ""
    file = io.StringIO()
    names = list(dict.fromkeys(name for record in records for name in record))
    writer = csv.DictWriter(file, names, lineterminator="\n")
    writer.writeheader()
    writer.writerows({key: _harmless(value) for key, value in record.items()} for record in records)
    return file.getvalue()


def _harmless(value: Any) -> Any:
    return f"'{value}" if isinstance(value, str) and value.startswith(("=", "@", "+", "-")) else value


def unfinished(cells: pd.DataFrame) -> Table | None:
    """Return the cells that failed, are missing or were stopped, with their causes; None where all are done."""
    rest = cells[cells["status"] != "done"] if len(cells) else cells
    if rest.empty:
        return None
    order = {"failed": 0, "stopped": 1, "missing": 2}
    rest = rest.sort_values("status", key=lambda column: column.map(order), kind="stable")
    names = ["status", "task", "agent", "source", "seed", "cell_id"]
    records = [{**{n: row[n] for n in names}, "cause": _cause(row)} for row in rest.to_dict("records")]
    rows = tuple(_failure(record) for record in records[:MAX_FAILURES])
    listed = "every one" if len(records) <= MAX_FAILURES else f"the first {MAX_FAILURES}; the CSV has them all"
    caption = f"{len(records)} cells without a finished evaluation curve: {listed}. None of them is in any average."
    columns = tuple((name.replace("_id", ""), name == "seed") for name in (*names, "cause"))
    return Table("unfinished", caption, columns, rows, text_csv(records))


def _cause(row: dict[Any, Any]) -> str:
    error = row.get("error")
    return error if isinstance(error, str) and error else CAUSES.get(str(row["status"]), "unknown")


def _failure(record: dict[str, Any]) -> tuple[Datum, ...]:
    shown = {"agent": Datum(record["agent"], record["agent"], agent=record["agent"])}
    shown["seed"] = Datum(str(record["seed"]), float(record["seed"]))
    shown["cell_id"] = Datum(record["cell_id"], record["cell_id"], code=True)
    return tuple(shown.get(name, Datum(str(value), str(value))) for name, value in record.items())
