"""Seeds crossed with source networks: a seed counts once, and both are random in an interval."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest

from orchestrator.analysis import statistics
from orchestrator.analysis.curves.bands import curve_bands
from orchestrator.analysis.groups import groups
from orchestrator.analysis.inference import crossed as crossed_mean
from orchestrator.analysis.inference.seeds import networks, whole_seeds
from orchestrator.analysis.selection import select
from orchestrator.analysis.tables.summary_table import numbers, row
from orchestrator.planning.arms import Label
from orchestrator.results.tables.cell_row import cell_row
from trainables.cell import Cell, Source

ORIGIN, REVERSED = "windy_gridworld", "windy_gridworld:wind=reversed"
FIGURES = ("auc", "training_auc", "initial_return", "final_return", "asymptotic")


def crossed(aucs: list[list[float]], threshold: float = 3.0) -> list[dict[str, object]]:
    """The rows of delta_gate, aucs[seed][network]."""
    rows = []
    for seed, line in enumerate(aucs):
        for network, auc in enumerate(line):
            source = Source(task=ORIGIN, kind="learned", cell_id=str(network) * 16)
            cell = Cell.create("delta_gate", REVERSED, seed, {"threshold": threshold}, source)
            rows.append(
                cell_row("transfer", cell, None, Label("each")) | {"status": "done"} | dict.fromkeys(FIGURES, auc)
            )
    return rows


def bases(aucs: list[float]) -> list[dict[str, object]]:
    cells = [Cell.create("q_learning", REVERSED, seed, {}) for seed in range(len(aucs))]
    return [
        cell_row("transfer", cell, None) | {"status": "done"} | dict.fromkeys(FIGURES, auc)
        for cell, auc in zip(cells, aucs, strict=True)
    ]


TABLE = pd.DataFrame([*bases([0.0, 1.0, 5.0]), *crossed([[1.0, 3.0], [2.0, 6.0], [7.0, 9.0]])])


def test_seeds_and_networks_are_random_in_every_statistic() -> None:
    base, gate = groups(TABLE)
    assert (gate.seeds, gate.networks, gate.complete) == ((0, 1, 2), 2, True)
    means = [2.0, 4.0, 8.0]
    assert gate.auc is not None
    assert gate.auc.value == pytest.approx(np.mean(means))
    both = crossed_mean.mean(np.array([[1.0, 2.0, 7.0], [3.0, 6.0, 9.0]]))
    assert (gate.auc.low, gate.auc.high) == pytest.approx((both.low, both.high))
    assert gate.against_base is not None
    assert gate.against_base.seeds == 3
    gaps = crossed_mean.mean(np.array([[1.0, 1.0, 2.0], [3.0, 5.0, 4.0]]))
    assert gate.against_base.difference == gaps
    assert gaps.value == statistics.difference(means, [0.0, 1.0, 5.0]).value
    assert base.networks == 1
    assert row(gate)[4] == "3 x 2 sources"
    assert numbers(gate)["source_networks"] == 2


def test_a_seed_with_an_unfinished_network_counts_in_nothing() -> None:
    table = TABLE.copy()
    table.loc[table.index[-1], "status"] = "failed"
    gate = groups(table)[1]
    assert (gate.seeds, gate.failed, gate.complete) == ((0, 1), 1, False)
    assert len(whole_seeds(table[table["group"] == gate.id])) == 4
    assert networks(table[table["group"] == gate.id]) == 2


def test_configurations_that_are_crossed_are_selected_by_the_means_of_their_seeds() -> None:
    table = pd.concat([TABLE, pd.DataFrame(crossed([[2.0, 4.0], [3.0, 7.0], [8.0, 10.0]], threshold=5.0))])
    (selected,) = (one for key, one in select(groups(table), table).items() if key.agent == "delta_gate")
    assert selected.best.hyperparameters["threshold"] == 5.0
    assert selected.ties == ()  # better by 1 for each seed and network


def test_the_band_of_a_curve_is_over_seeds() -> None:
    points = pd.DataFrame(
        [{"cell_id": row["cell_id"], "episode": 0, "greedy_return": row["auc"]} for row in TABLE.to_dict("records")]
    )
    gate = groups(TABLE)[1]
    band = curve_bands(points, TABLE, [gate.id], ["greedy_return"])[gate.id, "greedy_return"]
    wanted = statistics.mean([2.0, 4.0, 8.0])
    assert band[["mean", "low", "high"]].iloc[0].tolist() == pytest.approx([wanted.value, wanted.low, wanted.high])
