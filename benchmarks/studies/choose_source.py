"""AUC of every agent on every target of a sweep, as one Markdown table per kind of source.

`deltatune sweep choose-source`, then `python -m benchmarks.studies.choose_source results/choose-source`. Each entry is
the mean over seeds with its interval; in bold where the interval of the paired difference from the agent without
transfer is above 0, in italics where it is below. Incomplete configurations are left out.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path

from orchestrator.analysis.groups import Group, groups
from orchestrator.results.sweep_folder import Results

SHOWN = ("threshold", "nu")


def _name(group: Group) -> str:
    own = [f"{key} {group.hyperparameters[key]}" for key in SHOWN if key in group.hyperparameters]
    return " ".join([group.agent, *own])


def _entry(group: Group | None) -> str:
    if group is None or group.auc is None or group.auc.low is None:
        return "-"
    text = f"{group.auc.value:.1f} [{group.auc.low:.1f}, {group.auc.high:.1f}]"
    mark = {"helped": "**", "hurt": "*"}.get(group.verdict or "", "")
    return f"{mark}{text}{mark}"


def tables(shown: Sequence[Group]) -> str:
    """Return the tables as Markdown."""
    lines = []
    families = list(dict.fromkeys(group.task.partition(":")[0] for group in shown))
    for family in families:
        for kind in ("learned", "exact"):
            inside = [group for group in shown if group.task.partition(":")[0] == family and group.complete]
            here = [group for group in inside if group.source in (kind, "none")]
            targets = list(dict.fromkeys(group.task for group in here))
            seeds = sorted({len(group.seeds) for group in here})
            if not any(group.source == kind for group in here):
                continue
            lines += [f"\n`{family}`, {kind} sources, {' to '.join(map(str, seeds))} seeds:\n"]
            lines += ["|agent|" + "|".join(t.partition(":")[2] or "source" for t in targets) + "|"]
            lines += ["|---" * (len(targets) + 1) + "|"]
            for name in dict.fromkeys(map(_name, here)):
                mine = {group.task: group for group in here if _name(group) == name}
                lines.append(f"|{name}|" + "|".join(_entry(mine.get(target)) for target in targets) + "|")
    return "\n".join(lines)


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("sweep", type=Path)
    folder: Path = parser.parse_args().sweep
    results = Results.open(folder.parent, str(folder))
    every = groups(results.tables()[0])
    targets = {group.task for group in every if group.stage == "transfer"}
    print(tables([group for group in every if group.task in targets]))


if __name__ == "__main__":
    main()
