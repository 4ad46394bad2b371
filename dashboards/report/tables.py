"""The tables of the report: what is shown, what it is sorted by, and the same in full precision as CSV."""

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
from orchestrator.analysis.paper_table1 import same_row
from orchestrator.analysis.statistics import LEVEL, Estimate, TransferRatio
from orchestrator.analysis.summary_table import estimate_text, ratio_text

FAILURES = 300
"""Most cells that are listed one by one; the CSV has them all."""

CAUSES = {
    "missing": "not run, or its sweep was interrupted",
    "stopped": "ended early by the scheduler: an AUC of a shorter curve, compared with nothing",
}


@dataclass(frozen=True)
class Datum:
    """One cell of a table."""

    text: str
    sort: float | str | None = None
    """What it is sorted by; None: at the end."""
    agent: str = ""
    """Whose swatch stands before it."""
    mark: str = ""
    """helped or hurt: green or red, and a mark for who sees neither."""
    code: bool = False


@dataclass(frozen=True)
class Table:
    """A table that can be sorted and downloaded."""

    id: str
    caption: str
    columns: tuple[tuple[str, bool], ...]
    """(title, whether its column is of numbers)."""
    rows: tuple[tuple[Datum, ...], ...]
    csv: str
    folded: bool = False
    """Shown on demand."""


def table_1(findings: Findings, groups: Sequence[Group], name: str, caption: str, folded: bool = False) -> Table:
    """Groups with AUC, transfer ratio, difference and probability of improvement, and the paper's where it has them."""
    place = {task: number for number, task in enumerate(dict.fromkeys(group.task for group in findings.groups))}
    shown = sorted(in_order(groups), key=lambda group: place[group.task])
    paper = any(same_row(group) for group in shown)
    columns = [("task", False), ("agent", False), ("source", False), ("settings", False), ("seeds", True)]
    columns += [("AUC mean (sd)", True), (f"transfer ratio [{LEVEL:.0%}]", True), (f"difference [{LEVEL:.0%}]", True)]
    columns += [(f"P(improvement) [{LEVEL:.0%}]", True), *([("the paper's", True)] if paper else [])]
    rows = tuple(_row(group, findings.common) + ((_paper(group),) if paper else ()) for group in shown)
    return Table(name, caption, tuple(columns), rows, text_csv(_records(shown)), folded)


def _row(group: Group, hide: Collection[str]) -> tuple[Datum, ...]:
    against = group.against_base
    short = group.failed + group.missing + group.stopped
    seeds = f"{len(group.seeds)} of {len(group.seeds) + short}" if short else f"{len(group.seeds)}"
    auc = "–" if group.auc is None else f"{group.auc.value:.2f} ({group.auc_sd:.2f})"
    ratio, gap = (against.transfer_ratio, against.difference) if against else (None, None)
    return (
        Datum(group.task, group.task),
        Datum(group.agent, group.agent, agent=group.agent),
        Datum("–" if group.source_label == "none" else group.source_label, group.source),
        Datum(settings(group, hide) or "–", settings(group, hide)),
        Datum(seeds, len(group.seeds)),
        Datum(minus(auc), group.auc.value if group.auc else None),
        Datum(minus(ratio_text(ratio)) if ratio else "–", ratio.value if ratio else None, mark=group.verdict or ""),
        Datum(minus(estimate_text(gap)) if gap else "–", gap.value if gap else None),
        Datum(_share(against.probability_of_improvement) if against else "–", _chance(group)),
    )


def _chance(group: Group) -> float | None:
    return group.against_base.probability_of_improvement.value if group.against_base else None


def _share(estimate: Estimate) -> str:
    """'0.98 [0.90, 1.00]'."""
    ends = "" if estimate.low is None or estimate.high is None else f" [{estimate.low:.2f}, {estimate.high:.2f}]"
    return f"{estimate.value:.2f}{ends}"


def _paper(group: Group) -> Datum:
    row = same_row(group)
    return Datum(minus(str(row)), row.auc) if row else Datum("–")


def _records(groups: Iterable[Group]) -> list[dict[str, Any]]:
    return [_record(group) for group in groups]


def _record(group: Group) -> dict[str, Any]:
    """A group's line of the CSV: every number by itself and in full."""
    against, paper = group.against_base, same_row(group)
    record: dict[str, Any] = {"task": group.task, "agent": group.agent, "source": group.source}
    record |= {"source_task": group.source_task, "pick": group.pick or None}
    record |= {"settings": settings(group), "seeds_done": len(group.seeds), "seeds_failed": group.failed}
    record |= {"seeds_missing": group.missing, "seeds_stopped": group.stopped}
    record |= _ends("auc", group.auc) | {"auc_sd": group.auc_sd}
    record |= _ends("transfer_ratio", against.transfer_ratio if against else None)
    record |= _ends("difference", against.difference if against else None)
    record |= _ends("probability_of_improvement", against.probability_of_improvement if against else None)
    record |= {"paper_auc": paper.auc if paper else None, "paper_sd": paper.sd if paper else None}
    return record | {"paper_transfer_ratio_percent": paper.transfer_ratio if paper else None}


def _ends(name: str, estimate: Estimate | TransferRatio | None) -> dict[str, float | None]:
    ends = (None,) * 3 if estimate is None else (estimate.value, estimate.low, estimate.high)
    return dict(zip((name, f"{name}_low", f"{name}_high"), ends, strict=True))


def text_csv(records: Sequence[dict[str, Any]]) -> str:
    """Records as CSV; a text that a spreadsheet would take for a formula gets an apostrophe before it."""
    if not records:
        return ""
    file = io.StringIO()
    writer = csv.DictWriter(file, list(records[0]), lineterminator="\n")
    writer.writeheader()
    writer.writerows({key: _harmless(value) for key, value in record.items()} for record in records)
    return file.getvalue()


def _harmless(value: Any) -> Any:
    return f"'{value}" if isinstance(value, str) and value.startswith(("=", "@", "+", "-")) else value


def unfinished(cells: pd.DataFrame) -> Table | None:
    """The cells that failed, are missing or were stopped, with their causes; None where all are done."""
    rest = cells[cells["status"] != "done"] if len(cells) else cells
    if rest.empty:
        return None
    order = {"failed": 0, "stopped": 1, "missing": 2}
    rest = rest.sort_values("status", key=lambda column: column.map(order), kind="stable")
    names = ["status", "task", "agent", "source", "seed", "cell_id"]
    records = [{**{n: row[n] for n in names}, "cause": _cause(row)} for row in rest.to_dict("records")]
    rows = tuple(_failure(record) for record in records[:FAILURES])
    listed = "every one" if len(records) <= FAILURES else f"the first {FAILURES}; the CSV has them all"
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
