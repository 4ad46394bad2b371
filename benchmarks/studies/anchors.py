"""AUCs of the tabular agents compared with those of an independent prototype: `python -m benchmarks.studies.anchors`.

Plain Python, no Ray: every seed trains its own source by Q-learning, then every agent on every target. The anchors are
means (and standard deviations) over 20 seeds, recorded with one decimal or none.
"""

from __future__ import annotations

import argparse
import json
import math
import multiprocessing
import statistics
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from typing import Any

from trainables import curve
from trainables.cell import Cell, Source
from trainables.knowledge import Knowledge
from trainables.training.train import train

SE_FLOOR = 0.2
"""Least standard error of a difference, since anchors are rounded, at worst to a unit."""


@dataclass(frozen=True)
class Anchor:
    """An AUC of the prototype."""

    target: str
    agent: str
    kind: str
    """learned, exact or none: the origin of Q_src."""
    mean: float
    sd: float | None = None
    """Standard deviation over its seeds; None where it is unknown, and that of the agents here is used."""
    values: Mapping[str, Any] = field(default_factory=dict)
    seeds: int = 20

    @property
    def source_task(self) -> str:
        """Return the source task: the family at its defaults."""
        return self.target.partition(":")[0]


@dataclass(frozen=True)
class Row:
    """An anchor and the AUC here."""

    anchor: Anchor
    ours: float
    ours_sd: float
    seeds: int
    se: float
    """Standard error of the difference of the two means."""

    @property
    def difference(self) -> float:
        """Return the AUC here minus the anchor, in standard errors."""
        return (self.ours - self.anchor.mean) / self.se


def _gridworld() -> list[Anchor]:
    # target: q_learning (mean, sd), ppr, reuse exact, reuse learned, gate learned (mean, sd), gate exact at 10 and 3,
    # then the two agents beyond the paper with the exact source: confidence_gate, q_warm_start (10 seeds each)
    table: dict[str, tuple[Any, ...]] = {
        "windy_gridworld": ((-71.6, 2.0), -74.0, -44.5, -50.4, (-50.4, None), -44.5, -44.5, -44.5, -54.3),
        "windy_gridworld:wind=small": ((-72.2, 1.5), -74.4, -44.5, -53.2, (-53.2, 3.0), -44.53, -44.5, -44.5, -54.5),
        "windy_gridworld:wind=additional_1": ((-69.8, 1.8), -71.7, -200, -200, (-188, 28), -200, -100, -69.5, -54.1),
        "windy_gridworld:wind=additional_2": ((-54.0, 1.4), -57.2, -196, -198, (-116, 56), -142, -70, -55.9, -42.1),
        "windy_gridworld:wind=reversed": ((-37.7, 1.8), -41.3, -200, -200, (-38.7, 2.7), -199.93, -37.8, -38.1, -28.1),
    }
    anchors = []
    for target, (q, ppr, reuse_exact, reuse_learned, gate, gate_10, gate_3, confident, warm) in table.items():
        anchors += [
            Anchor(target, "q_learning", "none", *q),
            Anchor(target, "ppr", "learned", ppr, values={"nu": 0.99}),
            # Its curve is constant, so one evaluation is as good as all of them.
            Anchor(target, "policy_reuse", "exact", reuse_exact, values={"episodes": 1}),
            Anchor(target, "policy_reuse", "learned", reuse_learned, values={"episodes": 1}),
            Anchor(target, "delta_gate", "learned", *gate, values={"threshold": 10.0}),
            Anchor(target, "delta_gate", "exact", gate_10, values={"threshold": 10.0}),
            Anchor(target, "delta_gate", "exact", gate_3, values={"threshold": 3.0}),
            Anchor(target, "confidence_gate", "exact", confident, seeds=10),
            Anchor(target, "q_warm_start", "exact", warm, seeds=10),
        ]
    return anchors


def _supply_chain() -> list[Anchor]:
    # target: q_learning (mean, sd), delta_gate, ppr with nu .99 and .9; the learned source
    table = {
        "supply_chain:demand_mean=2": ((62.6, 8.1), 72.7, 71.6, 76.5),
        "supply_chain:demand_mean=5": ((108.7, 35.0), 153.0, 142.0, 164.0),
    }
    anchors = []
    for target, (q, gate, slow, fast) in table.items():
        anchors += [
            Anchor(target, "q_learning", "none", *q),
            Anchor(target, "delta_gate", "learned", gate),
            Anchor(target, "ppr", "learned", slow, values={"nu": 0.99}),
            Anchor(target, "ppr", "learned", fast, values={"nu": 0.9}),
        ]
    return anchors


ANCHORS: tuple[Anchor, ...] = (*_gridworld(), *_supply_chain())


def measure(seeds: int = 20, processes: int | None = None) -> list[Row]:
    """Return a row per anchor, from `seeds` seeds, in `processes` processes (default: one per CPU)."""
    families = dict.fromkeys(anchor.source_task for anchor in ANCHORS)
    jobs = [(family, seed) for family in families for seed in range(seeds)]
    with multiprocessing.get_context("spawn").Pool(processes or multiprocessing.cpu_count()) as pool:
        by_seed = dict(zip(jobs, pool.map(_one_seed, jobs, chunksize=1), strict=True))
    return [_row(index, anchor, by_seed, seeds) for index, anchor in enumerate(ANCHORS)]


def _row(index: int, anchor: Anchor, by_seed: Mapping[tuple[str, int], Mapping[int, float]], seeds: int) -> Row:
    values = [by_seed[anchor.source_task, seed][index] for seed in range(seeds)]
    sd = statistics.stdev(values)
    anchor_sd = sd if anchor.sd is None else anchor.sd
    se = math.sqrt(sd**2 / seeds + anchor_sd**2 / anchor.seeds)
    return Row(anchor, statistics.fmean(values), sd, seeds, max(se, SE_FLOOR))


def _one_seed(job: tuple[str, int]) -> dict[int, float]:
    """Return anchor index to AUC, for every anchor of one family and one seed."""
    family, seed = job
    source_cell = Cell.create("q_learning", family, seed)
    training = train(source_cell)
    for _ in training:
        pass
    learned = training.knowledge()
    return {
        index: _auc(anchor, seed, source_cell.id, learned)
        for index, anchor in enumerate(ANCHORS)
        if anchor.source_task == family
    }


def _auc(anchor: Anchor, seed: int, source_id: str, learned: Knowledge) -> float:
    source = {
        "none": None,
        "exact": Source(task=anchor.source_task, kind="exact"),
        "learned": Source(task=anchor.source_task, kind="learned", cell_id=source_id),
    }[anchor.kind]
    cell = Cell.create(anchor.agent, anchor.target, seed, dict(anchor.values), source)
    return curve.auc([point.greedy_return for point in train(cell, learned if anchor.kind == "learned" else None)])


def table(rows: Iterable[Row]) -> str:
    """Return the rows as text, one line each."""
    lines = [f"{'target':34} {'agent':16} {'source':8} {'setting':16} {'anchor':>14} {'ours':>14} {'diff/se':>8}"]
    for row in rows:
        anchor = row.anchor
        setting = ",".join(f"{key}={value:g}" for key, value in anchor.values.items() if key != "episodes")
        sd = "" if anchor.sd is None else f" ({anchor.sd:g})"
        lines.append(
            f"{anchor.target:34} {anchor.agent:16} {anchor.kind:8} {setting:16} {f'{anchor.mean:g}{sd}':>14} "
            f"{f'{row.ours:.1f} ({row.ours_sd:.1f})':>14} {row.difference:>+8.1f}"
        )
    return "\n".join(lines)


def main(arguments: Sequence[str] | None = None) -> None:
    """Print the table, or the rows as JSON."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.studies.anchors", description=__doc__)
    parser.add_argument("--seeds", type=int, default=20, help="seeds 0..N-1, at least 2 (default 20)")
    parser.add_argument("--json", action="store_true", help="rows as JSON")
    options = parser.parse_args(arguments)
    if options.seeds < 2:
        parser.error(f"--seeds must be at least 2 (got {options.seeds})")
    rows = measure(options.seeds)
    if options.json:
        print(json.dumps([{**asdict(row), "difference": row.difference} for row in rows], indent=1))
    else:
        print(table(rows))


if __name__ == "__main__":
    main()
