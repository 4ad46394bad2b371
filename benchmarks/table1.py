"""Our Table 1 beside the paper's, as Markdown, from finished sweeps: `python -m benchmarks.table1 results/NAME ...`."""

from __future__ import annotations

import argparse
from pathlib import Path

from orchestrator.aggregates import Group, groups
from orchestrator.describe import estimate_text, ratio_text, settings_text, varied
from orchestrator.results import Results
from orchestrator.selection import select
from trainables.tasks import parse_task

PAPER = {
    "cartpole:gravity=5x": {"dqn": "139.4 (11.7)", "es": "157.0 (11.1), +12.9%", "delta_es": "163.8 (14.1), +17.8%"},
    "cartpole:gravity=7x": {"dqn": "131.8 (10.9)", "es": "127.6 (14.2), -2.9%", "delta_es": "158.6 (2.4), +21.0%"},
    "acrobot:link_mass=1.5": {"dqn": "-172.7 (26.9)", "es": "-161.3 (14.4), +6%", "delta_es": "-150.1 (5.0), +13.0%"},
    "acrobot:link_mass=2": {"dqn": "-228.6 (12.0)", "es": "-233.0 (20.4), -1.9%", "delta_es": "-228.4 (15.6), +0.1%"},
    "lunar_lander:mass=1.1": {"dqn": "178.3 (13.8)", "es": "171.1 (7.8), -4%", "delta_es": "181.5 (7.4), +1.7%"},
    "lunar_lander:mass=0.75": {"dqn": "223.5 (6.8)", "es": "219.8 (11.0), -1.6%", "delta_es": "228.0 (5.0), +3.7%"},
    "reacher:y_force=0.75": {"dqn": "-5.96 (0.1)", "es": "-5.71 (0.1), +3.9%", "delta_es": "-5.66 (0.08), +4.8%"},
    "reacher:y_force=1": {"dqn": "-6.38 (0.28)", "es": "-6.17 (0.09), +3.3%", "delta_es": "-6.09 (0.22), +4.4%"},
}
"""Table 1 of the paper: AUC mean (sd) and transfer ratio."""


PAPER_SHARE = 0.25
"""The advice fraction of Table 1 (Appendix C)."""


def named(group: Group) -> dict[str, object]:
    """The hyperparameters that tell the agent's configurations apart."""
    values = varied(group.agent, group.task, group.hyperparameters)
    return {name: value for name, value in values.items() if name in ("threshold", "nu", "advice_fraction")}


def row(group: Group) -> str:
    """A group's line of the table."""
    its_share = group.hyperparameters.get("advice_fraction", PAPER_SHARE) == PAPER_SHARE
    paper = {parse_task(task).name: values for task, values in PAPER.items()}.get(group.task, {}).get(group.agent, "-")
    paper = paper if its_share else "-"
    against = group.against_base
    own = settings_text({"learning_rate": group.hyperparameters["learning_rate"]} | named(group))
    mean = (
        f"{group.auc.value:.2f} ({group.auc_sd:.2f}) [{group.auc.low:.1f}, {group.auc.high:.1f}]" if group.auc else "-"
    )
    ratio, gap = (ratio_text(against.transfer_ratio), estimate_text(against.difference)) if against else ("-", "-")
    better = f"{against.probability_of_improvement.value:.2f}" if against else "-"
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
