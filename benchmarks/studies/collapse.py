"""Which option of the base learner keeps DQN from collapsing after it has solved CartPole.

`deltatune sweep benchmarks/studies/collapse.yaml`, then `python -m benchmarks.studies.collapse [--storage results]`,
prints Markdown: for each base learner its AUC, the mean of the evaluations after the first of at least SOLVED, how many
of those are below half of it, and the paired differences from the paper's base learner, corrected by Holm's method.
"""

from __future__ import annotations

import argparse
import json
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pandas as pd

from orchestrator import markdown
from orchestrator.analysis import statistics
from orchestrator.analysis.inference.multiplicity import holm
from orchestrator.analysis.inference.pairs import difference, paired
from orchestrator.results.sweep_folder import Results

SOLVED = 195.0
"""Gymnasium's threshold for CartPole of 200 steps."""
MEASURES = {"auc": "AUC", "held": "mean after it was solved", "asymptotic": "asymptotic performance"}


class BaseLearner(NamedTuple):
    """The options that are compared."""

    replay_capacity: int
    double: bool
    loss: str

    def __str__(self) -> str:
        return f"{self.replay_capacity:,}, {'double' if self.double else 'plain'}, {self.loss}"


PAPER = BaseLearner(10_000, False, "squared")


def seeds(results: Results) -> dict[BaseLearner, pd.DataFrame]:
    """Return, for each base learner, a row per seed: the cells table's, with `held` and `collapsed`."""
    cells, points = results.write_tables()
    cells = cells[(cells["stage"] == "transfer") & (cells["status"] == "done")]
    curves = {cell: curve.sort_values("episode")["greedy_return"] for cell, curve in points.groupby("cell_id")}
    after = [_after(curves[cell].to_numpy()) for cell in cells["cell_id"]]
    cells = cells.assign(held=[a.mean() for a in after], collapsed=[(a < SOLVED / 2).mean() for a in after])
    options = [json.loads(text) for text in cells["hyperparameters"]]
    names = [BaseLearner(o["replay_capacity"], o.get("double", False), o.get("loss", "squared")) for o in options]
    return {name: cells[[each == name for each in names]] for name in sorted(set(names))}


def _after(curve: np.ndarray) -> np.ndarray:
    """Return the evaluations after the first that is solved; all where none is."""
    solved = np.flatnonzero(curve >= SOLVED)
    return curve[solved[0] + 1 :] if len(solved) and solved[0] + 1 < len(curve) else curve


def report(found: dict[BaseLearner, pd.DataFrame]) -> list[str]:
    """Return both tables."""
    first = [
        (name, len(rows), f"{100 * rows['collapsed'].mean():.0f} %", *(_mean(rows[key]) for key in MEASURES))
        for name, rows in found.items()
    ]
    base, others = found[PAPER], {name: rows for name, rows in found.items() if name != PAPER}
    rows = [(name, label, _gap(other, base, key)) for key, label in MEASURES.items() for name, other in others.items()]
    corrected = holm([1.0 if gap.p is None else gap.p for *_, gap in rows])
    second = [
        (name, label, f"{gap.value:+.1f} [{gap.low:+.1f}, {gap.high:+.1f}]", f"{p:.3f}")
        for (name, label, gap), p in zip(rows, corrected, strict=True)
    ]
    head = [
        "replay, targets, loss",
        "seeds",
        "later evaluations below half",
        *(f"{each} (sd)" for each in MEASURES.values()),
    ]
    return [
        *markdown.table(head, first),
        "",
        *markdown.table(["replay, targets, loss", "measure", "difference from the paper's [95 %]", "p (Holm)"], second),
    ]


def _mean(values: pd.Series) -> str:
    return f"{values.mean():.1f} ({values.std():.1f})"


def _gap(other: pd.DataFrame, base: pd.DataFrame, column: str) -> statistics.Estimate:
    found = difference(paired(other, base), column)
    assert found is not None
    return found


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--storage", type=Path, default=Path("results"), help="the sweep's storage (%(default)s)")
    print("\n".join(report(seeds(Results.open(parser.parse_args().storage, "collapse")))))


if __name__ == "__main__":
    main()
