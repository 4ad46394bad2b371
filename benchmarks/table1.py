"""Our Table 1 beside the paper's, as Markdown, from finished sweeps: `python -m benchmarks.table1 results/NAME ...`."""

from __future__ import annotations

import argparse
from pathlib import Path

from orchestrator.analysis.groups import Group, groups
from orchestrator.analysis.labels import settings_text, varied
from orchestrator.analysis.metrics import DIFFERENCE, TRANSFER_RATIO
from orchestrator.analysis.paper_table1 import table_1
from orchestrator.analysis.selection import select
from orchestrator.results.sweep_folder import Results


def named(group: Group) -> dict[str, object]:
    """The hyperparameters that tell the agent's configurations apart."""
    values = varied(group.agent, group.task, group.hyperparameters)
    return {name: value for name, value in values.items() if name in ("threshold", "nu", "advice_fraction")}


def row(group: Group) -> str:
    """A group's line of the table."""
    paper = str(table_1(group) or "-")
    own = settings_text({"learning_rate": group.hyperparameters["learning_rate"]} | named(group))
    mean = (
        f"{group.auc.value:.2f} ({group.auc.sd:.2f}) [{group.auc.low:.1f}, {group.auc.high:.1f}]" if group.auc else "-"
    )
    ratio, gap = (metric.text(group.estimates.get(metric.key)) for metric in (TRANSFER_RATIO, DIFFERENCE))
    chance = group.estimate("probability_of_improvement")
    better = f"{chance.value:.2f}" if chance else "-"
    source = "" if group.source == "none" else f" ({group.source})"
    cells = (group.task, group.agent + source, own, str(len(group.seeds)), mean, ratio, gap, better, paper)
    return "|" + "|".join(cells) + "|"


def main() -> None:
    """Print the table of each sweep that is named."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("sweeps", nargs="+", type=Path)
    parser.add_argument("--all", action="store_true", help="every configuration, not the best alone")
    arguments = parser.parse_args()
    head = ("task", "agent", "hyperparameters", "seeds", "AUC mean (sd) [95%]", "transfer ratio [95%]")
    head += ("difference [95%]", "P(improvement)", "paper")
    for folder in arguments.sweeps:
        results = Results.open(folder.parent, str(folder))
        cells, _ = results.tables()
        every = groups(cells)
        shown = every if arguments.all else [selected.best for selected in select(every, cells).values()]
        training = cells["seconds"].sum() / 3600
        print(f"\n`{results.name}`: {len(cells)} cells, {training:.2f} core-hours of training.\n")
        print("|" + "|".join(head) + "|\n" + "|---" * len(head) + "|")
        print("\n".join(row(group) for group in sorted(shown, key=lambda group: group.task)))


if __name__ == "__main__":
    main()
