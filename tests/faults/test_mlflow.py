"""MLflow is away: the sweep does not notice, says so at its end, and `sync` makes good for it."""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from conftest import CELLS
from harness import assert_same
from mlflow.tracking import MlflowClient

from benchmarks.tracking_server import TrackingServer
from orchestrator import tracker, tracking
from orchestrator.findings import find
from orchestrator.record import Record
from orchestrator.results import Results
from orchestrator.tracker import Tracker
from trainables.cell import content_id


def kinds(server: TrackingServer, results: Results) -> Counter[str]:
    """How many finished runs there are of each kind."""
    client = MlflowClient(server.uri)
    experiment = client.get_experiment_by_name("deltatune/tests")
    assert experiment is not None
    sweep_id = content_id([results.name, results.meta()["created"]])
    found = client.search_runs([experiment.experiment_id], f"tags.sweep_id = '{sweep_id}'", max_results=1000)
    assert {run.info.status for run in found} == {"FINISHED"}
    assert len(
        {(run.data.tags["kind"], run.data.tags.get("cell_id"), run.data.tags.get("group")) for run in found}
    ) == len(found)
    return Counter(run.data.tags["kind"] for run in found)


@pytest.fixture(scope="module")
def server(tmp_path_factory: pytest.TempPathFactory) -> Iterator[TrackingServer]:
    server = TrackingServer(tmp_path_factory.mktemp("server"))
    server.start()
    yield server
    server.kill()


@pytest.fixture(autouse=True)
def _impatient(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(tracker, "FIRST_PAUSE", 0.2)


ALL = {"cell": CELLS, "aggregate": 2 + 2 * (1 + 2 + 4), "sweep": 1}


def tracked(storage: Path, uri: str, harm: Callable[[int], None] = lambda cells: None) -> tuple[Results, Tracker]:
    """A sweep that is tracked, with something done to MLflow after each cell."""
    from conftest import SPACE
    from rich.console import Console

    from orchestrator.settings import Settings
    from orchestrator.sweep import run
    from search_spaces import parse

    results = Results.create(storage, "small", parse("small", SPACE))
    follower = Tracker(results, uri)
    seen = 0

    def told(stage: str, record: Record) -> None:
        nonlocal seen
        seen += 1
        harm(seen)
        follower.record(stage, record)

    assert run(results, Settings(), Console(quiet=True), told).failed == 0
    return results, follower


def test_a_server_that_is_killed_and_comes_back_has_everything(
    server: TrackingServer, finished: Path, tmp_path: Path, ray_session: None
) -> None:
    def harm(cells: int) -> None:
        if cells == 10:
            server.kill()
        if cells == 20:
            server.start()

    results, follower = tracked(tmp_path, server.uri, harm)
    assert follower.finish(find(results), []) is not None
    assert follower.error is None
    assert kinds(server, results) == ALL
    assert_same(tmp_path, finished)


def test_a_server_that_is_gone_for_the_rest_of_the_sweep_is_made_good_for_by_sync(
    server: TrackingServer, tmp_path: Path, ray_session: None
) -> None:
    results, follower = tracked(tmp_path, server.uri, lambda cells: server.kill() if cells == 10 else None)
    assert follower.finish(find(results), []) is None
    assert follower.error is not None
    server.start()
    for _ in range(2):
        tracking.sync(find(results), server.uri, [])
        assert kinds(server, results) == ALL


def test_a_store_that_is_down_from_the_start_never_holds_a_sweep_up(
    finished: Path, tmp_path: Path, ray_session: None
) -> None:
    started = time.monotonic()
    results, follower = tracked(tmp_path, "http://127.0.0.1:9")
    assert follower.finish(find(results), []) is None
    assert time.monotonic() - started < 200
    assert_same(tmp_path, finished)


def test_a_queue_that_is_full_is_caught_up_with_at_the_end(
    finished: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(tracker, "WAITING", 1)
    import shutil

    shutil.copytree(finished, tmp_path / "copy")
    results = Results.open(tmp_path / "copy", "small")
    follower = Tracker(results, f"sqlite:///{tmp_path}/mlflow.db")
    for stage, _, record in results.records():
        assert record is not None
        follower.record(stage, record)
    assert follower.finish(find(results), []) is not None
    client = MlflowClient(follower.uri)
    experiment = client.get_experiment_by_name("deltatune/tests")
    assert experiment is not None
    runs = client.search_runs([experiment.experiment_id], max_results=1000)
    assert Counter(run.data.tags["kind"] for run in runs) == ALL
