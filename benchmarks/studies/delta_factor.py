"""How much of the advice delta's factor leaves, in its unit and without one, on all four deep tasks.

`python -m benchmarks.studies.delta_factor` prints Markdown from the published dataset, with `--storage results` from
sweeps of delta_factor_500.yaml and delta_factor_100.yaml: the mean factor of `relative_es` where the advice acted, the
paper's exp(-max |delta|) at the same states, and max |delta|, on the source's own task, where an ideal factor is 1, and
on its targets: in the first and the last fifth of the episodes, and how far the latter is from that on the own task,
paired by seed.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterable
from pathlib import Path

import pandas as pd

from benchmarks.reproduction.tables import interval, plain
from orchestrator import markdown
from orchestrator.analysis.statistics import difference, mean
from orchestrator.dataset.dataset import Dataset
from orchestrator.results.sweep_folder import Results
from trainables.tasks.registry import parse_task

SWEEPS = ("delta-factor-500", "delta-factor-100")
STATISTICS = {
    "advised_factor": "factor without a unit",
    "advised_paper_factor": "the paper's factor",
    "advised_delta": "max \\|delta\\|",
}
PART = 0.2


def factors(cells: pd.DataFrame, points: pd.DataFrame) -> pd.DataFrame:
    """Return a row per task and seed: STATISTICS in the first and in the last PART of the episodes."""
    cells = cells[cells["agent"] == "relative_es"]
    rows = cells[["cell_id", "task", "seed"]].merge(points, on="cell_id")
    share = rows["episode"] / rows.groupby("cell_id")["episode"].transform("max")
    parts = {"first": rows[(share > 0) & (share <= PART)], "last": rows[share > 1 - PART]}
    means = {name: part.groupby(["task", "seed"])[list(STATISTICS)].mean() for name, part in parts.items()}
    return pd.concat(means, axis=1).reset_index()


def report(found: pd.DataFrame) -> list[str]:
    """Return the table, a row per task."""
    columns = [text for label in STATISTICS.values() for text in (f"{label} [95 %]", "less that on the own task")]
    return markdown.table(["task", "seeds", *columns], _rows(found))


def _rows(found: pd.DataFrame) -> Iterable[tuple[object, ...]]:
    for task, mine in found.groupby("task"):
        own = parse_task(str(task)).family.name
        mine, base = (rows.set_index("seed") for rows in (mine, found[found["task"] == own]))
        row: list[object] = [task, len(mine)]
        for column in STATISTICS:
            first, last = mine["first", column].mean(), list(mine["last", column])
            gap = "-" if task == own else interval(difference(last, list(base["last", column].loc[mine.index])), 2)
            row += [f"{first:.2f}, {plain(mean(last))}", gap]
        yield tuple(row)


def published(dataset: Dataset) -> pd.DataFrame:
    """Return the factors of the published cells."""
    cells = dataset.cells[dataset.cells["sweep"].isin(SWEEPS)]
    return factors(cells, dataset.points(list(cells["cell_id"])))


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--storage", type=Path, help="the storage of sweeps of your own (default: what is published)")
    storage = parser.parse_args().storage
    if storage is None:
        found = published(Dataset(Path("docs/dataset")))
    else:
        parts = [factors(*Results.open(storage, name).write_tables()) for name in SWEEPS]
        found = pd.concat(parts, ignore_index=True)
    print("\n".join(report(found)))


if __name__ == "__main__":
    main()
