"""MLflow is a copy that can be made again: no duplicates, no NaN, nothing lost."""

from __future__ import annotations

import math
import re
import shutil
from collections import Counter
from pathlib import Path
from typing import Any

import mlflow
import pytest
from conftest import CELLS, GROUPS
from mlflow.entities import Run
from mlflow.tracking import MlflowClient
from rich.console import Console

from deltatune.publish import artifacts, publish
from orchestrator.analysis.findings import find
from orchestrator.analysis.labels import group_name
from orchestrator.errors import LeaseLostError, SweepError
from orchestrator.execution import sweep as sweeps
from orchestrator.results.sweep_folder import Results
from orchestrator.tracking.mlflow import fields
from orchestrator.tracking.mlflow.mirror import Mirror
from orchestrator.tracking.mlflow.views import LEADERBOARD
from orchestrator.tracking.sync import sync, sync_now
from orchestrator.tracking.tracker import Tracker
from orchestrator.tracking.uri import tracking_uri
from tests.orchestrator.local_sweeps import LOCAL, space
from tests.small_figures import small_figures
from trainables.errors import InputError

pytestmark = pytest.mark.usefixtures("quick_mlflow", "quick_figures")


@pytest.fixture(scope="module")
def mirrored(finished: Path, tmp_path_factory: pytest.TempPathFactory) -> Results:
    """A published and synchronised sweep."""
    storage = tmp_path_factory.mktemp("mirrored") / "storage"
    shutil.copytree(finished, storage)
    results = Results.open(storage, "small")
    with small_figures():
        publish(results)
    sync(find(results), tracking_uri(storage, None), artifacts(results))
    return results


@pytest.fixture(scope="module")
def few(tmp_path_factory: pytest.TempPathFactory) -> Results:
    """A sweep of 8 cells, where any will do: each is a run that takes MLflow a tenth of a second to write."""
    storage = tmp_path_factory.mktemp("few")
    results = Results.create(storage, "small", space(agents={"q_learning": {}, "policy_reuse": {}}))
    assert sweeps.run(results, LOCAL, Console(quiet=True)).ran == 8
    results.write_tables()
    return results


FEW = {"cell": 8, "aggregate": 8, "sweep": 1}


def client(results: Results) -> MlflowClient:
    return MlflowClient(tracking_uri(results.storage, None))


def runs(results: Results, condition: str = "") -> list[Run]:
    store = client(results)
    experiment = store.get_experiment_by_name("deltatune/tests")
    assert experiment is not None
    return list(store.search_runs([experiment.experiment_id], condition, max_results=1000))


def kinds(results: Results) -> Counter[str]:
    return Counter(run.data.tags["kind"] for run in runs(results))


def test_there_is_a_run_per_cell_per_group_and_for_the_sweep(mirrored: Results) -> None:
    assert kinds(mirrored) == {"cell": CELLS, "aggregate": GROUPS, "sweep": 1}
    assert {run.info.status for run in runs(mirrored)} == {"FINISHED"}


def test_a_cell_run_says_what_the_cell_was_and_ends_at_the_tables_figures(mirrored: Results) -> None:
    cells, _ = mirrored.tables()
    row = cells[(cells["agent"] == "delta_gate") & (cells["seed"] == 0)].iloc[0]
    run = runs(mirrored, f"tags.cell_id = '{row['cell_id']}'")[0]
    assert run.data.metrics["auc"] == row["auc"]
    wanted = {"agent": "delta_gate", "seed": "0", "task": row["task"], "source": row["source"], "stage": "transfer"}
    assert wanted.items() <= run.data.tags.items()
    assert {"commit", "version.numpy", "version.ray"} <= set(run.data.tags)
    assert run.data.params["threshold"] == "10.0"
    above = runs(mirrored, f"tags.group = '{row['group']}'")[0]
    parent = runs(mirrored, "tags.kind = 'sweep'")[0]
    assert run.data.tags["mlflow.parentRunId"] == above.info.run_id
    assert above.data.tags["mlflow.parentRunId"] == parent.info.run_id


def test_cells_of_an_older_store_are_put_below_their_aggregates(mirrored: Results) -> None:
    store, cells = client(mirrored), runs(mirrored, "tags.kind = 'cell'")
    before = {run.info.run_id: run.data.tags["mlflow.parentRunId"] for run in cells}
    sweep = runs(mirrored, "tags.kind = 'sweep'")[0].info.run_id
    for run in cells:
        store.set_tag(run.info.run_id, "mlflow.parentRunId", sweep)
    sync(find(mirrored), tracking_uri(mirrored.storage, None), [])
    after = {run.info.run_id: run.data.tags["mlflow.parentRunId"] for run in runs(mirrored, "tags.kind = 'cell'")}
    assert after == before


def test_the_leaderboard_goes_task_by_task_and_shows_rounded_numbers(mirrored: Results) -> None:
    shown = runs(mirrored, LEADERBOARD.condition)
    shown.sort(key=lambda run: run.data.tags["place"])
    tasks = [run.data.tags["task"] for run in shown]
    assert tasks == sorted(tasks, key=tasks.index)
    for task in set(tasks):
        aucs = [run.data.metrics["auc"] for run in shown if run.data.tags["task"] == task]
        assert aucs == sorted(aucs, reverse=True)
    assert all(re.fullmatch(r"-?\d+\.\d\d \(\d+\.\d\d\)", run.data.tags["AUC"]) for run in shown)
    assert {run.data.tags["verdict"] for run in shown} <= {"helped", "hurt", "undecided", "baseline"}


def test_the_leaderboard_is_whole_before_the_first_cell(
    few: Results, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def stopped(self: Mirror, *words: object) -> None:
        raise SweepError("stopped before the first cell")

    results = _copy(few, tmp_path)
    with monkeypatch.context() as patched:
        patched.setattr(Mirror, "write_cell", stopped)
        with pytest.raises(SweepError, match="before the first cell"):
            sync(find(results), tracking_uri(results.storage, None), [])
    assert kinds(results) == {"aggregate": FEW["aggregate"], "sweep": 1}
    first = {run.info.run_id: run.data for run in runs(results, "tags.kind = 'aggregate'")}
    sync(find(results), tracking_uri(results.storage, None), [])
    assert kinds(results) == FEW
    again = {run.info.run_id: run.data for run in runs(results, "tags.kind = 'aggregate'")}
    assert {run_id: (data.metrics, data.tags) for run_id, data in again.items()} == {
        run_id: (data.metrics, data.tags) for run_id, data in first.items()
    }
    assert all("auc" in data.metrics for data in first.values())


def test_a_configuration_whose_place_has_changed_keeps_its_run(few: Results, tmp_path: Path) -> None:
    results = _copy(few, tmp_path)
    uri = tracking_uri(results.storage, None)
    sync(find(results), uri, [])
    before = {run.info.run_id: run.data.tags for run in runs(results, LEADERBOARD.condition)}
    for run_id in before:
        client(results).set_tag(run_id, "place", "99.99")
    sync(find(results), uri, [])
    assert {run.info.run_id: run.data.tags for run in runs(results, LEADERBOARD.condition)} == before


def test_the_sweeps_run_has_the_answer_as_metrics_and_first_in_its_description(mirrored: Results) -> None:
    parent, best = runs(mirrored, "tags.kind = 'sweep'")[0], find(mirrored).best
    counts = Counter(group.verdict for group in best if group.against_base)
    for name in ("helped", "hurt", "undecided"):
        assert parent.data.metrics[f"transfer_{name}"] == counts[name]
    assert sum(name.startswith("best_auc ") for name in parent.data.metrics) == len(
        {group.task for group in best} - {"windy_gridworld"}
    )
    assert parent.data.tags["mlflow.note.content"].startswith("|best on|agent|seeds|AUC|transfer ratio|verdict|")


def test_a_curve_has_the_episode_as_its_step(mirrored: Results) -> None:
    run = runs(mirrored, "tags.kind = 'cell' and tags.agent = 'delta_gate'")[0]
    for name in ("greedy_return", "max_abs_delta", "gate_open_share"):
        history = client(mirrored).get_metric_history(run.info.run_id, name)
        assert [metric.step for metric in history] == list(range(0, 70, 10))


def test_an_aggregate_has_the_statistics_of_its_group(mirrored: Results) -> None:
    run = runs(mirrored, "tags.kind = 'aggregate' and tags.agent = 'policy_reuse'")[0]
    names = {"auc", "auc_low", "auc_high", "auc_sd", "transfer_ratio", "difference", "jumpstart", "asymptotic", "seeds"}
    assert names <= set(run.data.metrics)
    assert run.data.metrics["seeds"] == 2
    history = client(mirrored).get_metric_history(run.info.run_id, "greedy_return_mean")
    assert len(history) == 7


def test_no_metric_is_a_nan_or_an_infinity(mirrored: Results) -> None:
    assert all(math.isfinite(value) for run in runs(mirrored) for value in run.data.metrics.values())


def test_the_parent_has_a_description_and_the_figures(mirrored: Results) -> None:
    parent = runs(mirrored, "tags.kind = 'sweep'")[0]
    assert "delta_gate" in parent.data.tags["mlflow.note.content"]
    files = [item.path for item in client(mirrored).list_artifacts(parent.info.run_id)]
    assert {"best.yaml", "table.csv", "configurations.csv", "cells.parquet", "points.parquet", "figures"} <= set(files)


def test_synchronising_twice_changes_nothing(mirrored: Results) -> None:
    before = {run.info.run_id: run.data.metrics for run in runs(mirrored)}
    sync(find(mirrored), tracking_uri(mirrored.storage, None), artifacts(mirrored))
    assert {run.info.run_id: run.data.metrics for run in runs(mirrored)} == before


def test_a_run_that_was_cut_off_is_made_whole_without_double_points(mirrored: Results, tmp_path: Path) -> None:
    results = _copy(mirrored, tmp_path)
    store = client(results)
    run = runs(results, "tags.kind = 'cell' and tags.agent = 'delta_gate'")[0]
    store.update_run(run.info.run_id, status="RUNNING")
    sync(find(results), tracking_uri(results.storage, None), [])
    assert kinds(results) == {"cell": CELLS, "aggregate": GROUPS, "sweep": 1}
    assert store.get_run(run.info.run_id).info.status == "FINISHED"
    assert len(store.get_metric_history(run.info.run_id, "greedy_return")) == 7


def test_a_run_that_was_cut_off_before_its_figures_is_no_run_that_is_there(
    few: Results, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    results, store = few, f"sqlite:///{tmp_path}/mlflow.db"

    def dies(*_: Any, **__: Any) -> None:
        raise OSError("gone")

    with monkeypatch.context() as patch:
        patch.setattr(MlflowClient, "log_batch", dies)
        stage, _, record = next(each for each in results.records() if each[2])
        with pytest.raises(OSError, match="gone"):
            Mirror(results, store).write_cell(stage, record.head, lambda: record)
    experiment = (client := MlflowClient(store)).get_experiment_by_name("deltatune/tests")
    assert experiment is not None
    (cut,) = client.search_runs([experiment.experiment_id], "tags.kind = 'cell'")
    assert (cut.info.status, cut.data.metrics) == ("RUNNING", {})
    sync(find(results), store, [])
    whole = client.get_run(cut.info.run_id)
    assert (whole.info.status, whole.data.metrics["auc"]) == ("FINISHED", _auc(results, whole.data.tags["cell_id"]))


def test_a_cell_that_is_gone_from_the_results_is_gone_from_mlflow(mirrored: Results, tmp_path: Path) -> None:
    results = _copy(mirrored, tmp_path)
    plan = results.plan()
    plan["transfer"] = plan["transfer"][:-8]
    results.set_plan(plan)
    results.write_tables()
    sync(find(results), tracking_uri(results.storage, None), [])
    assert kinds(results)["cell"] == CELLS - 8


def test_a_tracker_with_a_dead_store_never_harms_the_sweep(finished: Path, tmp_path: Path) -> None:
    shutil.copytree(finished, tmp_path / "dead")
    results = Results.open(tmp_path / "dead", "small")
    tracker = Tracker(results, "sqlite:////dev/null/no/mlflow.db")
    for stage, _, record in results.records():
        assert record is not None
        tracker.record(stage, record)
    assert tracker.finish(find(results), []) is None
    assert tracker.error is not None
    with pytest.raises(SweepError, match="cannot be written to"):
        sync_now(find(results), "sqlite:////dev/null/no/mlflow.db", [])


def test_a_tracker_writes_what_it_is_told_and_the_rest_at_the_end(few: Results, tmp_path: Path) -> None:
    results = _copy(few, tmp_path)
    tracker = Tracker(results, tracking_uri(results.storage, None))
    for stage, _, record in list(results.records())[:3]:
        assert record is not None
        tracker.record(stage, record)
    assert tracker.finish(find(results), []) is not None
    assert kinds(results) == FEW


def test_a_cell_is_put_below_its_aggregate_at_once(
    few: Results, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    store, moved = f"sqlite:///{tmp_path}/mlflow.db", list[tuple[Any, ...]]()
    plain = MlflowClient.set_tag

    def noted(client: MlflowClient, *words: Any, **more: Any) -> None:
        moved.append(words)
        plain(client, *words, **more)

    monkeypatch.setattr(MlflowClient, "set_tag", noted)
    sync(find(few), store, [])
    assert not [words for words in moved if words[1] in ("mlflow.parentRunId", "of_group")]
    client = MlflowClient(store)
    experiment = client.get_experiment_by_name("deltatune/tests")
    assert experiment is not None
    found = client.search_runs([experiment.experiment_id], max_results=1000)
    groups = {group.id: group_name(group) for group in find(few).groups}
    below = {run.info.run_id: run for run in found if run.data.tags["kind"] == "aggregate"}
    assert {run.data.tags["group"]: run.info.run_name for run in below.values()} == groups
    for run in found:
        if run.data.tags["kind"] == "cell":
            above = below[run.data.tags["mlflow.parentRunId"]]
            assert above.data.tags["group"] in run.data.tags["of_group"].split(", ")


def test_an_aggregate_of_a_sweep_that_was_stopped_is_not_left_running(few: Results, tmp_path: Path) -> None:
    uri = f"sqlite:///{tmp_path}/mlflow.db"
    tracker = Tracker(few, uri)
    backend = tracker._connected()
    stage, _, record = next(few.records())
    assert record is not None
    backend.write_cell(stage, record.head, lambda: record)
    tracker._backend = backend
    tracker.stop("KILLED")
    client = MlflowClient(uri)
    experiment = client.get_experiment_by_name("deltatune/tests")
    assert experiment is not None
    found = client.search_runs([experiment.experiment_id])
    assert {run.data.tags["kind"]: run.info.status for run in found} == {
        "cell": "FINISHED",
        "aggregate": "KILLED",
        "sweep": "KILLED",
    }
    sync(find(few), uri, [])
    kinds = Counter(run.data.tags["kind"] for run in client.search_runs([experiment.experiment_id], max_results=1000))
    assert kinds == FEW


def test_who_has_lost_the_writing_to_another_makes_no_request(mirrored: Results, tmp_path: Path) -> None:
    allowed = [True] * 1000

    def check() -> None:
        if not allowed:
            raise LeaseLostError("another writes")
        allowed.pop()

    stage, _, record = next(mirrored.records())
    assert record is not None
    backend = Mirror(mirrored, f"sqlite:///{tmp_path}/mlflow.db", check)
    backend.write_cell(stage, record.head, lambda: record)
    database = MlflowClient(f"sqlite:///{tmp_path}/mlflow.db")
    (experiment,) = database.search_experiments(filter_string="name = 'deltatune/tests'")

    def there() -> list[Any]:
        return [run.to_dictionary() for run in database.search_runs([experiment.experiment_id])]

    before = there()
    allowed.clear()
    second = list(mirrored.records())[1][2]
    for write in (
        lambda: backend.write_cell(stage, second.head, lambda: second),  # type: ignore[union-attr]
        lambda: backend.write_configurations(find(mirrored)),
        lambda: backend.finish(find(mirrored), []),
        lambda: backend.end("KILLED"),
    ):
        with pytest.raises(LeaseLostError):
            write()
    assert there() == before
    allowed.append(True)  # one request of several: the next one is not made
    with pytest.raises(LeaseLostError):
        backend.write_cell(stage, second.head, lambda: second)  # type: ignore[union-attr]


def test_thinned_curves_keep_their_ends() -> None:
    curve = [(step, float(step)) for step in range(0, 5010, 10)]
    for metric, points in (("greedy_return", 51), ("greedy_return_mean", 51), ("max_abs_delta", 17)):
        thin = fields.thinned(metric, curve)
        assert len(thin) == len(set(thin)) == points
        assert (thin[0], thin[-1]) == (curve[0], curve[-1])
        assert fields.thinned(metric, curve[:5]) == curve[:5]


def test_a_store_that_mlflow_does_not_know_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(InputError, match="must start with sqlite:"):
        tracking_uri(tmp_path, "ftp://host/x")
    monkeypatch.setenv("MLFLOW_TRACKING_URI", "http://127.0.0.1:5000")
    assert tracking_uri(tmp_path, None) == "http://127.0.0.1:5000"
    assert tracking_uri(tmp_path, "sqlite:///x.db") == "sqlite:///x.db"


def _copy(results: Results, tmp_path: Path) -> Results:
    shutil.copytree(results.storage, tmp_path / "copy")
    return Results.open(tmp_path / "copy", "small")


def _auc(results: Results, cell_id: str) -> float:
    cells, _ = results.tables()
    return float(cells.set_index("cell_id").at[cell_id, "auc"])


def test_an_aggregate_has_its_target_and_its_source_task_as_datasets(mirrored: Results) -> None:
    for run in runs(mirrored, "tags.kind = 'aggregate'"):
        found = {
            (each.dataset.name, each.tags[0].value)
            for each in client(mirrored).get_run(run.info.run_id).inputs.dataset_inputs
        }
        tags = run.data.tags
        wanted = {(tags["task"], "target" if tags["stage"] == "transfer" else "source")}
        wanted |= {(tags["source_task"], "source")} if tags["source"] != "none" else set()
        assert found == wanted
        assert len(found) == len(client(mirrored).get_run(run.info.run_id).inputs.dataset_inputs)


def test_the_sweeps_run_has_its_configurations_as_a_table_once(mirrored: Results) -> None:
    findings, uri = find(mirrored), tracking_uri(mirrored.storage, None)
    sync(findings, uri, artifacts(mirrored))
    parent = runs(mirrored, "tags.kind = 'sweep'")[0].info
    mlflow.set_tracking_uri(uri)
    try:
        table = MlflowClient().load_table(parent.experiment_id, "results.json", [parent.run_id])
    finally:
        mlflow.set_tracking_uri(None)  # type: ignore[arg-type]
    assert sorted(table["auc"]) == pytest.approx(sorted(group.auc.value for group in findings.groups if group.auc))
    assert {"transfer_ratio", "transfer_ratio_low", "verdict", "agent", "task"} <= set(table)


def test_a_renamed_sweep_keeps_its_runs(mirrored: Results, tmp_path: Path) -> None:
    from orchestrator.results.admin import rename
    from orchestrator.tracking.mlflow.rename import rename_runs

    shutil.copytree(mirrored.storage, tmp_path / "copy")
    uri = tracking_uri(tmp_path / "copy", None)
    before = {run.info.run_id for run in runs(Results.open(tmp_path / "copy", "small"))}
    moved = rename(Results.open(tmp_path / "copy", "small"), "large")
    assert rename_runs(moved, "small", uri) == len(before)
    assert rename_runs(moved, "small", uri) == 0
    publish(moved)
    sync(find(moved), uri, artifacts(moved))
    assert {run.info.run_id for run in runs(moved)} == before
    assert {run.data.tags["sweep"] for run in runs(moved)} == {"large"}
    assert runs(moved, "tags.kind = 'sweep'")[0].info.run_name == "large"
