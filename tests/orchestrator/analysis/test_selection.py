"""What is selected, what is compared with what, and that a failed cell is never averaged away."""

from __future__ import annotations

import json
from typing import Any

import pandas as pd
import pytest

from orchestrator.analysis.curves.bands import curve_bands
from orchestrator.analysis.groups import groups
from orchestrator.analysis.selection import select
from orchestrator.analysis.tables.summary_table import row
from orchestrator.planning.arms import Key
from trainables.cell import Cell, Source

TASK = "windy_gridworld:wind=small"


def cell_rows(agent: str, aucs: list[float | None], **hyperparameters: Any) -> list[dict[str, Any]]:
    """One row per seed; None: that seed's cell has failed."""
    source = None if agent == "q_learning" else Source(task="windy_gridworld", kind="exact")
    rows = []
    for seed, auc in enumerate(aucs):
        cell = Cell.create(agent, TASK, seed, hyperparameters, source)
        rows.append(
            {
                "cell_id": cell.id,
                "stage": "transfer",
                "status": "failed" if auc is None else "done",
                "agent": agent,
                "task": TASK,
                "source": "none" if source is None else "exact",
                "source_task": source.task if source else None,
                "seed": seed,
                "group": cell.group,
                "auc": auc,
                "training_auc": auc,
                "initial_return": auc,
                "asymptotic": auc,
                "hyperparameters": json.dumps(cell.hyperparameters, sort_keys=True),
            }
        )
    return rows


def best_rate(*rows: list[dict[str, Any]]) -> Any:
    cells = pd.DataFrame([row for group in rows for row in group])
    return select(groups(cells), cells)[Key(TASK, "q_learning")]


def test_the_highest_mean_auc_wins() -> None:
    selected = best_rate(
        cell_rows("q_learning", [-50.0, -52.0], learning_rate=0.1),
        cell_rows("q_learning", [-40.0, -42.0], learning_rate=0.5),
    )
    assert selected.best.hyperparameters["learning_rate"] == 0.5
    assert selected.tried == 2


def test_the_first_of_equals_wins_also_at_index_and_seed_zero() -> None:
    selected = best_rate(
        cell_rows("q_learning", [-50.0], learning_rate=0.1), cell_rows("q_learning", [-50.0], learning_rate=0.5)
    )
    assert selected.best.hyperparameters["learning_rate"] == 0.1
    assert selected.best.seeds == (0,)
    assert len(selected.ties) == 1


def test_a_group_with_a_failed_cell_is_never_selected_however_good_its_others() -> None:
    selected = best_rate(
        cell_rows("q_learning", [-1.0, None], learning_rate=0.1),
        cell_rows("q_learning", [-90.0, -91.0], learning_rate=0.5),
    )
    assert selected.best.hyperparameters["learning_rate"] == 0.5
    assert selected.left_out == 1


def test_a_failed_cell_is_counted_and_its_group_has_no_mean_of_it() -> None:
    cells = pd.DataFrame(cell_rows("q_learning", [-10.0, None, -20.0]))
    group = groups(cells)[0]
    assert (len(group.seeds), group.failed, group.complete) == (2, 1, False)
    assert group.auc is not None
    assert group.auc.value == pytest.approx(-15.0)


def test_a_cell_that_was_stopped_early_is_counted_and_its_auc_compared_with_nothing() -> None:
    rows = cell_rows("q_learning", [-10.0, -1.0, -20.0])
    rows[1]["status"] = "stopped"
    cells = pd.DataFrame(rows)
    group = groups(cells)[0]
    assert (group.seeds, group.stopped, group.complete) == ((0, 2), 1, False)
    assert group.auc is not None
    assert group.auc.value == pytest.approx(-15.0)
    assert not select(groups(cells), cells)
    assert row(group)[4] == "2, 1 stopped early"


def test_a_clear_loser_is_no_tie_and_a_close_one_is() -> None:
    selected = best_rate(
        cell_rows("q_learning", [-40.0, -41.0, -42.0], learning_rate=0.5),
        cell_rows("q_learning", [-40.5, -40.4, -42.3], learning_rate=0.1),
        cell_rows("q_learning", [-90.0, -91.0, -92.0], learning_rate=0.05),
    )
    assert [tie.hyperparameters["learning_rate"] for tie in selected.ties] == [0.1]


def test_transfer_is_compared_with_the_base_of_the_same_hyperparameters() -> None:
    rows = cell_rows("q_learning", [-100.0, -102.0], learning_rate=0.1)
    rows += cell_rows("q_learning", [-50.0, -51.0], learning_rate=0.5)
    rows += cell_rows("delta_gate", [-50.0, -51.0], learning_rate=0.1)
    group = groups(pd.DataFrame(rows))[-1]
    assert group.against_base is not None
    assert group.against_base.difference.value == pytest.approx(50.5)
    assert group.against_base.transfer_ratio.value == pytest.approx(0.5)


def test_without_a_base_nothing_is_compared() -> None:
    group = groups(pd.DataFrame(cell_rows("delta_gate", [-50.0, -51.0])))[0]
    assert group.against_base is None


def test_a_comparison_is_paired_by_the_seeds_that_both_have() -> None:
    rows = cell_rows("q_learning", [-100.0, None, -100.0]) + cell_rows("delta_gate", [-50.0, -1.0, -60.0])
    comparison = groups(pd.DataFrame(rows))[-1].against_base
    assert comparison is not None
    assert comparison.seeds == 2
    assert comparison.difference.value == pytest.approx(45.0)


def test_a_mean_curve_has_the_mean_and_a_band_at_each_point() -> None:
    cells = pd.DataFrame(cell_rows("q_learning", [1.0, 3.0]))
    points = pd.DataFrame(
        {
            "cell_id": [*[cells["cell_id"][0]] * 2, *[cells["cell_id"][1]] * 2],
            "episode": [0, 10, 0, 10],
            "greedy_return": [0.0, 1.0, 2.0, 1.0],
        }
    )
    curve = curve_bands(points, cells, [cells["group"][0]], ["greedy_return"])[cells["group"][0], "greedy_return"]
    assert list(curve["mean"]) == [1.0, 1.0]
    assert curve["low"][0] < 1.0 < curve["high"][0]
    assert curve["low"][1] == curve["high"][1] == 1.0


def test_curves_of_many_groups_at_once_are_those_of_each() -> None:
    cells = pd.DataFrame(cell_rows("q_learning", [1.0, 3.0, None]) + cell_rows("delta_gate", [2.0, 5.0, 4.0]))
    shape = {"episode": [0, 10], "max_abs_delta": [None, 2.0]}
    frames = [
        pd.DataFrame(shape | {"cell_id": row.cell_id, "greedy_return": [row.seed, 1.0]}) for row in cells.itertuples()
    ]
    points = pd.concat(frames)
    names = list(cells["group"].unique())
    columns = ["greedy_return", "max_abs_delta", "kappa"]
    every = curve_bands(points, cells, names, columns)
    for name in names:
        for column in columns:
            pd.testing.assert_frame_equal(
                every[name, column], curve_bands(points, cells, [name], [column])[name, column]
            )
    assert list(every[names[0], "greedy_return"]["mean"]) == [0.5, 1.0]
    assert list(every[names[0], "max_abs_delta"]["episode"]) == [10]
    assert every[names[0], "kappa"].empty
