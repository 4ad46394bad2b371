"""What `seeds: auto` errs, and what it costs, beside 20 fixed seeds: simulated sweeps from recorded results.

`python -m benchmarks.studies.sequential_seeds` draws the seeds of each simulated sweep, with replacement, from the 20
of the published dataset (docs/dataset), an AUC of every agent for each. *Equal*: at every seed the agents change places
at random, so that every decision is wrong. *Two equal*: the first two agents alone do, and a decision between them is
wrong. *As recorded*: a decision against the sign of the recorded difference is wrong. Beside AdaStop stand 20 fixed
seeds with paired t tests and Holm's correction, on the same draws.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from orchestrator.analysis.contrasts.contrast import of_interest
from orchestrator.analysis.inference.adastop import Design, decide
from orchestrator.analysis.inference.multiplicity import holm
from orchestrator.dataset.dataset import Dataset
from orchestrator.markdown import table
from trainables.tasks.registry import parse_task

DATASET = Path(__file__).parents[2] / "docs" / "dataset"
FIXED = 20
"""Seeds without a sequential test."""

Aucs = Mapping[str, NDArray[np.float64]]
"""Agent to its AUC at each of the recorded seeds."""
Truth = Literal["equal", "two equal", "as recorded"]
TRUTHS: tuple[Truth, ...] = ("equal", "two equal", "as recorded")

SCENARIOS: dict[str, tuple[str, str, dict[str, dict[str, float]]]] = {
    "CartPole x5": ("table1-cartpole", "cartpole:gravity=5x", {"delta_es": {}, "es": {}, "dqn": {}}),
    "CartPole x7": ("table1-cartpole", "cartpole:gravity=7x", {"delta_es": {}, "es": {}, "dqn": {}}),
    "gridworld 2": (
        "paper-gridworld",
        "windy_gridworld:wind=reversed",
        {"delta_gate": {"threshold": 10.0}, "ppr": {"nu": 0.99}, "q_learning": {}},
    ),
    "supply chain 1": (
        "paper-supply-chain",
        "supply_chain:demand_mean=2",
        {"delta_gate": {"threshold": 5.0}, "ppr": {"nu": 0.99}, "q_learning": {}},
    ),
}
"""Sweep, target, and its agents with what distinguishes their configuration; the first two are made equal."""


@dataclass(frozen=True)
class Row:
    """What the simulated sweeps of one scenario came to; shares of 1."""

    error: float
    """Sweeps with one wrong decision or more: the family-wise error."""
    decided: float
    """Comparisons decided rightly, of those that can be."""
    cells: float
    """Cells, of those of FIXED seeds."""
    fixed_error: float
    fixed_decided: float


def recorded(name: str, dataset: Dataset) -> Aucs:
    """Return the recorded AUCs of a scenario, with a learned source."""
    sweep, target, agents = SCENARIOS[name]
    cells = dataset.cells
    cells = cells[(cells["sweep"] == sweep) & (cells["task"] == parse_task(target).name) & (cells["source"] != "exact")]
    found = {}
    for agent, settings in agents.items():
        mine = cells[cells["agent"] == agent].sort_values("seed")
        values = [json.loads(text)["hyperparameters"] for text in mine["cell"]]
        aucs = mine["auc"][[settings.items() <= each.items() for each in values]].to_numpy(np.float64)
        found[agent] = aucs[:FIXED]
    return found


def simulate(aucs: Aucs, truth: Truth, design: Design, sweeps: int) -> Row:
    """Return error, decisions and cells over simulated sweeps."""
    agents, pairs = list(aucs), of_interest(aucs)
    rng = np.random.default_rng(0)
    sign = {pair: 0.0 if _equal(pair, truth, agents) else float(np.sign(_gap(aucs, pair))) for pair in pairs}
    real = max(1, sum(side != 0 for side in sign.values()))
    wrong, right, cells = np.zeros((sweeps, 2)), np.zeros((sweeps, 2)), np.zeros(sweeps)
    for number in range(sweeps):
        drawn = _drawn(aucs, truth, design.group * design.looks, rng)
        outcomes = decide({agent: drawn[agent].tolist() for agent in agents}, pairs, design)
        looks = [max(outcomes[pair].looks for pair in pairs if agent in pair) for agent in agents]
        cells[number] = design.group * sum(looks)
        said = {pair: {"better": 1, "worse": -1}.get(outcomes[pair].state, 0) for pair in pairs}
        for column, decisions in enumerate((said, _by_fixed_seeds(drawn, pairs))):
            wrong[number, column] = any(side not in (0, sign[pair]) for pair, side in decisions.items())
            right[number, column] = sum(side == sign[pair] != 0 for pair, side in decisions.items()) / real
    error, decided = wrong.mean(axis=0), right.mean(axis=0)
    return Row(error[0], decided[0], cells.mean() / (FIXED * len(agents)), error[1], decided[1])


def _equal(pair: tuple[str, str], truth: Truth, agents: list[str]) -> bool:
    return truth == "equal" or (truth == "two equal" and set(pair) == set(agents[:2]))


def _gap(aucs: Aucs, pair: tuple[str, str]) -> float:
    return float(aucs[pair[0]].mean() - aucs[pair[1]].mean())


def _drawn(aucs: Aucs, truth: Truth, seeds: int, rng: np.random.Generator) -> dict[str, NDArray[np.float64]]:
    """Return the AUCs of a simulated sweep at `seeds` seeds, or at FIXED ones where that is more."""
    table = np.stack(list(aucs.values()))[:, rng.integers(0, FIXED, max(seeds, FIXED))]
    mixed = {"equal": len(table), "two equal": 2, "as recorded": 0}[truth]
    table[:mixed] = rng.permuted(table[:mixed], axis=0)
    return dict(zip(aucs, table, strict=True))


def _by_fixed_seeds(drawn: Aucs, pairs: Iterable[tuple[str, str]]) -> dict[tuple[str, str], int]:
    """Return 1, -1 or 0 (undecided) for each comparison, from FIXED seeds at level .05."""
    pairs = list(pairs)
    gaps = np.stack([drawn[a][:FIXED] - drawn[b][:FIXED] for a, b in pairs], axis=1)
    p_values = holm([float(p) for p in stats.ttest_1samp(gaps, 0.0).pvalue])
    means = gaps.mean(axis=0)
    return {pair: int(np.sign(mean)) * (p <= 0.05) for pair, p, mean in zip(pairs, p_values, means, strict=True)}


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--scenarios", nargs="+", choices=list(SCENARIOS), default=list(SCENARIOS), help="which (all)")
    parser.add_argument("--sweeps", type=int, default=1000, help="simulated sweeps of each line (%(default)s)")
    parser.add_argument("--group", type=int, default=5, help="seeds of a group (%(default)s)")
    parser.add_argument("--max", type=int, nargs="+", default=[20, 30], help="budgets in seeds (%(default)s)")
    parser.add_argument("--alpha", type=float, default=0.05, help="family-wise error (%(default)s)")
    given = parser.parse_args()
    dataset = Dataset(DATASET)
    columns = ["scenario", "agents", "most seeds", "error", "decided", f"cells, of {FIXED} seeds'"]
    columns += [f"error of {FIXED} seeds", f"decided by {FIXED} seeds"]
    rows = []
    for truth in TRUTHS:
        for name in given.scenarios:
            for most in given.max:
                design = Design(given.group, most // given.group, given.alpha)
                row = simulate(recorded(name, dataset), truth, design, given.sweeps)
                shares = (row.error, row.decided, row.cells, row.fixed_error, row.fixed_decided)
                texts = [f"{100 * share:.1f} %" for share in shares]
                for place in (1, 4) if truth == "equal" else ():
                    texts[place] = "-"
                rows.append([name, truth, str(most), *texts])
    print("\n".join(table(columns, rows)))


if __name__ == "__main__":
    main()
