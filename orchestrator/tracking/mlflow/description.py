"""The description of a sweep in MLflow, as Markdown."""

from __future__ import annotations

import itertools
from collections.abc import Sequence

import yaml

from orchestrator.analysis.groups import Group
from orchestrator.analysis.metrics import METRICS
from orchestrator.analysis.selection import optimism
from orchestrator.analysis.tables.summary_table import CONFIRMED_COLUMNS, confirmed_texts, table
from orchestrator.markdown import table as markdown_table
from orchestrator.planning.confirmation import CONFIRMATION
from orchestrator.results.pretrained_names import options
from orchestrator.results.sweep_folder import Results
from orchestrator.tracking.mlflow.views import LEADERBOARD
from trainables.plugins.names import short


def markdown(results: Results, groups: Sequence[Group], best: Sequence[Group]) -> str:
    """Return the description of a sweep's parent run: its question, the table, the command that reproduces it."""
    space = results.space()
    lines = [*_headline(best), space.description or space.name, "", *_confirmed(best), "Every configuration:", ""]
    columns, rows = table(groups)
    lines += [*markdown_table(columns, ()), *_rows(rows)]
    lines += ["", "Transfer ratio and difference are against the same agent without transfer, paired by seed.", ""]
    lines += [
        f"To reproduce: `deltatune sweep SPACE.yaml --name {results.name}{options(results.folder)}`, with the search "
        "space below as SPACE.yaml.",
        "",
    ]
    lines += [
        f"Leaderboard: *Views* above the runs table, or its filter `{LEADERBOARD.condition}` sorted by `place`.",
        "",
    ]
    text = yaml.safe_dump(space.to_json(), sort_keys=False, width=110).rstrip()
    lines += ["```yaml", text, "```"] if len(text) < TABLE_CHARACTERS / 2 else ["The search space is in `sweep.json`."]
    return "\n".join(lines)


def _confirmed(best: Sequence[Group]) -> list[str]:
    """Return the table of what was confirmed on unseen seeds; nothing where nothing was."""
    shown = [group for group in best if group.confirmed]
    if not shown:
        return []
    columns = ("task", "agent", "source", *CONFIRMED_COLUMNS)
    rows = [(short(g.task), short(g.agent), g.source_label, *confirmed_texts(g.confirmed)) for g in shown]
    said = "Confirmed on seeds that had no part in the selection:"
    return [said, "", *markdown_table(columns, rows), ""]


def _headline(best: Sequence[Group]) -> list[str]:
    """Return a table of the best configuration on each target; MLflow shows only the first lines of a description."""
    judged = [group.judged for group in best if group.stage == "transfer"]
    shown = [group for group in judged if group.auc]
    if not shown:
        return []
    rows = []
    for task in dict.fromkeys(group.task for group in shown):
        group = max((one for one in shown if one.task == task), key=lambda one: one.auc.value if one.auc else 0.0)
        texts = [metric.text(group.estimates.get(metric.key)) for metric in METRICS if metric.key in HEADLINE]
        seeds = f"{len(group.seeds)}{' unseen' if group.stage in CONFIRMATION else ''}"
        rows.append((short(task), short(group.agent), seeds, *texts, group.verdict_text or "no transfer"))
    said = optimism(shown)
    return [
        *markdown_table(("best on", "agent", "seeds", "AUC", "transfer ratio", "verdict"), rows),
        "",
        *([said, ""] if said else []),
    ]


HEADLINE = ("auc", "transfer_ratio")

TABLE_CHARACTERS = 4000
"""Of the table in a description, of which MLflow keeps 8,000."""


def _rows(rows: Sequence[Sequence[str]]) -> list[str]:
    """Return the lines of a Markdown table, up to TABLE_CHARACTERS."""
    lines = ["|" + "|".join(cell.replace("|", "/") for cell in row) + "|" for row in rows]
    lengths = itertools.accumulate(len(line) + 1 for line in lines)
    kept = [line for line, length in zip(lines, lengths, strict=True) if length <= TABLE_CHARACTERS]
    more = len(lines) - len(kept)
    return [*kept, "", f"{more} more rows are in `table.csv`."] if more else kept
