"""Early stopping: of whole configurations, among their own pair's, never of a comparison's partner."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from conftest import LOCAL, SPACE
from hypothesis import given, settings
from hypothesis import strategies as st
from rich.console import Console

from orchestrator.analysis.groups import groups
from orchestrator.analysis.selection import select
from orchestrator.execution.executors.early_stopping import EarlyStopping, MedianStopping, Rule, SuccessiveHalving
from orchestrator.execution.settings import RunSummary
from orchestrator.execution.sweep import run
from orchestrator.planning.arms import Arm
from orchestrator.results.sweep_folder import Results
from search_spaces.loading import parse
from search_spaces.search_space import Scheduler
from trainables.cell import Cell
from trainables.errors import InputError
from trainables.training.cell_run import CellRun
from trainables.training.lockstep import lockstep
from trainables.training.train import train

RATES = [0.5, 0.3, 0.1, 0.05, 0.01, 0.002]


def space(method: str = "asha", **search: Any) -> dict[str, Any]:
    source = {"task": "windy_gridworld", "hyperparameters": {"learning_rate": RATES}}
    scheduler = {"method": method, "grace": 3, "reduction_factor": 2}
    return SPACE | {
        "scenarios": [{"source": source, "targets": ["windy_gridworld:wind=reversed"]}],
        "agents": {"q_learning": {}, "delta_gate": {"threshold": [10.0]}},
        "hyperparameters": {"episodes": [400], "evaluate_every": [20]},
        "search": {"method": "grid", "scheduler": scheduler} | search,
    }


def sweep(storage: Path, data: dict[str, Any]) -> tuple[Results, RunSummary]:
    results = Results.create(storage, "small", parse("small", data))
    return results, run(results, LOCAL, Console(quiet=True))


@pytest.fixture(scope="module")
def stopped(tmp_path_factory: pytest.TempPathFactory) -> Path:
    storage = tmp_path_factory.mktemp("stopped")
    _, tally = sweep(storage, space())
    assert tally.failed == 0
    assert tally.stopped > 0
    return storage


def test_what_was_stopped_is_marked_and_has_no_auc(stopped: Path) -> None:
    cells, _ = Results.open(stopped, "small").write_tables()
    early = cells[cells["status"] == "stopped"]
    assert len(early)
    assert early["auc"].isna().all()
    assert early["error"].str.startswith("stopped early by asha after ").all()
    assert set(early["stage"]) == {"source"}, "an agent with one configuration has no rival"


def test_all_seeds_of_a_configuration_are_stopped_together(stopped: Path) -> None:
    cells, points = Results.open(stopped, "small").write_tables()
    lengths = points.groupby("cell_id").size()
    for _, frame in cells[cells["stage"] == "source"].groupby("group"):
        assert frame["status"].nunique() == 1
        assert lengths[frame["cell_id"]].nunique() == 1


def test_a_stopped_configuration_is_never_selected_nor_compared(stopped: Path) -> None:
    cells, _ = Results.open(stopped, "small").write_tables()
    every = groups(cells)
    assert any(group.stopped for group in every)
    for selected in select(every, cells).values():
        assert not selected.best.stopped
    for group in every:
        assert group.auc is None or not group.stopped


def test_a_stopped_curve_is_the_beginning_of_the_full_one(stopped: Path) -> None:
    results = Results.open(stopped, "small")
    head = next(head for head in results.heads().values() if head.status == "stopped")
    record = results.record(head.cell.id)
    assert record is not None
    full = [point.greedy_return for point in train(head.cell)]
    assert record.returns == full[: len(record.returns)]
    assert len(record.returns) < len(full)


def test_the_same_command_runs_nothing_again_and_without_the_scheduler_what_was_stopped(stopped: Path) -> None:
    _, tally = sweep(stopped, space())
    assert tally.ran == 0
    whole = space()
    del whole["search"]
    results, tally = sweep(stopped, whole)
    assert tally.stopped == 0
    assert tally.ran >= 2
    assert {head.status for head in results.heads().values()} == {"done"}


def test_seeds_with_sources_of_their_own_are_stopped_together_too(tmp_path: Path) -> None:
    data = space()
    data["scenarios"][0]["source"]["hyperparameters"] = {"learning_rate": [0.5]}
    data["agents"] = {"q_learning": {}, "ppr": {"nu": [0.5, 0.7, 0.9, 0.99, 0.999]}}
    results, tally = sweep(tmp_path, data)
    assert tally.stopped > 0
    cells, _ = results.write_tables()
    assert cells.groupby("group")["status"].nunique().max() == 1


def test_median_stopping_stops_some_too(tmp_path: Path) -> None:
    _, tally = sweep(tmp_path, space("median"))
    assert tally.failed == 0
    assert tally.stopped > 0


def test_optuna_goes_on_with_what_was_stopped(tmp_path: Path) -> None:
    data = space(method="asha", budget=6)
    data["search"]["method"] = "optuna"
    rate = {"low": 0.002, "high": 0.5, "log": True}
    data["scenarios"][0]["source"]["hyperparameters"] = {"learning_rate": rate}
    results, tally = sweep(tmp_path, data)
    assert tally.failed == 0
    assert len({cell.group for cell in results.plan()["source"]}) == 6
    _, tally = sweep(tmp_path, data)
    assert tally.ran == 0


def judged(stopping: EarlyStopping, name: str, cell: Cell, scores: list[float]) -> int:
    """How many evaluations a trial gets."""
    for number, score in enumerate(scores, start=1):
        if stopping.stops(name, [cell], number, score):
            return number
    return len(scores)


def arm_of(cell: Cell) -> Arm:
    return Arm(cell.agent, cell.task, (cell.seed,), (dict(cell.hyperparameters),))


def test_a_resumed_scheduler_knows_what_earlier_runs_had() -> None:
    cell = Cell.create("q_learning", "windy_gridworld", 0, {"episodes": 100})
    scheduler = Scheduler(method="asha", grace=2, reduction_factor=2)
    bad, good = [0.0] * 10, [1.0] * 10
    fresh = EarlyStopping(scheduler, [arm_of(cell)], lambda arm: [])
    assert judged(fresh, "only", cell, bad) == 10
    resumed = EarlyStopping(scheduler, [arm_of(cell)], lambda arm: [good, good, good])
    assert judged(resumed, "only", cell, bad) == 2
    assert resumed.stopped == {"only": "stopped early by asha after 2 evaluations"}


def test_arms_do_not_compete() -> None:
    good, bad = (Cell.create("q_learning", task, 0, {"episodes": 100}) for task in ("windy_gridworld", "supply_chain"))
    stopping = EarlyStopping(
        Scheduler(method="asha", grace=2, reduction_factor=2), [arm_of(good), arm_of(bad)], lambda arm: []
    )
    assert judged(stopping, "good", good, [1.0] * 10) == 10
    assert judged(stopping, "bad", bad, [0.0] * 10) == 10


class Trial:
    """What Tune's schedulers need to know of one."""

    def __init__(self, name: str) -> None:
        self.trial_id = name


class Controller:
    """What Tune's schedulers ask for where they have too few samples."""

    def get_live_trials(self) -> list[Any]:
        return []


def both(method: str, grace: int, factor: float) -> tuple[Rule, Any]:
    """Our rule, and Tune's scheduler of the same settings."""
    from ray.tune.schedulers import AsyncHyperBandScheduler, MedianStoppingRule

    named = {"time_attr": "at", "metric": "score", "mode": "max"}
    if method == "asha":
        theirs = AsyncHyperBandScheduler(
            **named, max_t=40, grace_period=grace, reduction_factor=factor, stop_last_trials=False
        )
        return SuccessiveHalving(grace, 40, factor), theirs
    return MedianStopping(grace), MedianStoppingRule(**named, grace_period=grace, min_time_slice=10**9)


@pytest.mark.parametrize("method", ["asha", "median"])
@given(seed=st.integers(0, 10**6), grace=st.integers(1, 5), factor=st.sampled_from([1.5, 2, 3, 4]))
@settings(max_examples=30)
def test_our_rules_decide_as_tunes_schedulers_do(method: str, seed: int, grace: int, factor: float) -> None:
    rng = np.random.default_rng(seed)
    ours, theirs = both(method, grace, factor)
    trials = {name: Trial(name) for name in "abcdefgh"}
    reached = dict.fromkeys(trials, 0)
    for trial in trials.values():
        theirs.on_trial_add(Controller(), trial)
    while alive := [name for name in trials if reached[name] < 40]:
        name = str(rng.choice(alive))
        reached[name] += 1
        score = round(float(rng.normal(ord(name) / 10, 1)), 1)
        stops = ours.stops(name, reached[name], score)
        decision = theirs.on_trial_result(Controller(), trials[name], {"at": reached[name], "score": score})
        assert stops == (decision == "STOP")
        if stops:
            reached[name] = 40


def test_cells_in_lockstep_have_the_bits_of_cells_alone() -> None:
    cells = [Cell.create("q_learning", "windy_gridworld", seed, {"episodes": 60}) for seed in range(3)]
    runs = [CellRun(cell, lambda cell: None) for cell in cells]
    rungs = list(lockstep(runs))
    alone = [[point.greedy_return for point in train(cell)] for cell in cells]
    assert [run.returns() for run in runs] == alone
    assert [rung.evaluations for rung in rungs] == list(range(1, 8))
    for rung in rungs:
        assert rung.score == pytest.approx(np.mean([curve[: rung.evaluations] for curve in alone]))


def test_a_scheduler_takes_only_what_makes_sense() -> None:
    data = space()
    data["search"]["scheduler"] = {"method": "hyperband"}
    with pytest.raises(InputError, match=r"search\.scheduler\.method"):
        parse("x", data)
