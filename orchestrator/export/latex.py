"""Table 1 as LaTeX with the package booktabs."""

from __future__ import annotations

import re
from collections.abc import Sequence

from orchestrator.analysis.findings import Findings
from orchestrator.analysis.groups import Group
from orchestrator.analysis.labels import settings, settings_text
from orchestrator.analysis.metrics import Metric, present, signed
from orchestrator.analysis.selection import optimism
from orchestrator.analysis.statistics import LEVEL
from orchestrator.analysis.tables.paper_table1 import same_row

SPECIAL = {
    "\\": r"\textbackslash{}",
    "~": r"\textasciitilde{}",
    "^": r"\textasciicircum{}",
    "|": r"\textbar{}",
    "<": r"\textless{}",
    ">": r"\textgreater{}",
    **{character: f"\\{character}" for character in "&%$#_{}"},
}
"""LaTeX's special characters and how they are escaped."""

MARK = r"$^{\dagger}$"
"""Follows the number of seeds where they are unseen ones."""

UNSEEN = "on seeds that had no part in selecting the configuration."


def escape(text: str) -> str:
    """Return `text` escaped for LaTeX; line ends become spaces."""
    flat = " ".join(text.split())
    return re.sub("[" + re.escape("".join(SPECIAL)) + "]", lambda match: SPECIAL[match[0]], flat)


def table_1(findings: Findings) -> str:
    """Return the best configuration of each agent on each task, with the paper's numbers in a last column if any.

    What was confirmed has the figures of its unseen seeds, and a mark that the caption explains.
    """
    best = findings.best
    paper = any(same_row(group) for group in best)
    metrics = present("report", [group.judged for group in best])
    titles = [metric.latex or escape(metric.label[:1].upper() + metric.label[1:]) for metric in metrics]
    head = ["Agent", "Seeds", *titles, *(["Paper"] if paper else [])]
    lines = [rf"% {escape(findings.results.name)}: needs \usepackage{{booktabs}}", r"\begin{table}", r"\centering"]
    level = rf"{LEVEL * 100:.0f}\,\%"
    caption = f"{escape(findings.results.name)}: AUC, mean (sd) over seeds, and transfer with {level} intervals."
    caption += f" {MARK}: {UNSEEN}" if any(group.confirmed for group in best) else ""
    caption += f" {escape(said)}" if (said := optimism(best)) else ""
    lines += [rf"\caption{{{caption}}}", rf"\begin{{tabular}}{{l{'r' * (len(head) - 1)}}}", r"\toprule"]
    lines.append(" & ".join(head) + r" \\")
    for task in dict.fromkeys(group.task for group in best):
        lines += [r"\midrule", rf"\multicolumn{{{len(head)}}}{{l}}{{{escape(task)}}} \\"]
        lines += [" & ".join(_row(group, paper, metrics)) + r" \\" for group in best if group.task == task]
    return "\n".join([*lines, r"\bottomrule", r"\end{tabular}", r"\end{table}", ""])


def _row(group: Group, paper: bool, metrics: Sequence[Metric]) -> list[str]:
    text = settings_text(settings(group))
    name = (
        group.agent
        + ("" if group.source_label == "none" else f", {group.source_label}")
        + ("" if text == "-" else f" ({text})")
    )
    judged = group.judged
    cells = [r"\quad " + escape(name), f"{len(judged.seeds)}{MARK if group.confirmed else ''}"]
    cells += [
        metric.write(judged.estimates.get(metric.key), _number, missing="--", least=r"$\ge$ ") for metric in metrics
    ]
    row = same_row(group)
    return cells + ([f"{_number(row.auc, 2)} ({row.sd:g})" if row else "--"] if paper else [])


def _number(value: float, digits: int) -> str:
    """Return a number with LaTeX's minus and no plus, rounded as in the other tables."""
    return f"${signed(value, digits).removeprefix('+')}$"
