"""The load of the driver's machine in MLflow, on wish."""

from __future__ import annotations

import time
from pathlib import Path

import pytest
from mlflow.tracking import MlflowClient
from rich.console import Console

from orchestrator.execution.sweep import run
from orchestrator.results.sweep_folder import Results
from orchestrator.tracking.mlflow import system_metrics
from orchestrator.tracking.tracker import Tracker
from orchestrator.tracking.uri import tracking_uri
from tests.orchestrator.local_sweeps import LOCAL, space

pytestmark = pytest.mark.usefixtures("quick_mlflow")

ASKED = "MLFLOW_ENABLE_SYSTEM_METRICS_LOGGING"
PATIENCE = 60.0


@pytest.fixture
def tracked(tmp_path: Path) -> Tracker:
    """A tracker that has a record to write."""
    results = Results.create(tmp_path, "small", space())
    run(results, LOCAL, Console(quiet=True))
    return Tracker(results, tracking_uri(tmp_path, None))


def metrics(tracked: Tracker, first_of: str) -> set[str]:
    """The metrics of the sweep's run, once there is one that begins so or the first cell is there."""
    stage, _, record = next(tracked._results.records())
    assert record is not None
    tracked.record(stage, record)
    deadline = time.monotonic() + PATIENCE
    found: set[str] = set()
    while time.monotonic() < deadline and not any(name.startswith(first_of) for name in found):
        time.sleep(0.1)
        if tracked._backend is not None and (tracked._unwatch is not None):
            client = MlflowClient(tracked.uri)
            found = set(client.get_run(tracked._backend.parent).data.metrics)
            if not first_of:
                break
    tracked.stop()
    return found


def test_the_run_of_the_sweep_has_the_load_of_the_driver(tracked: Tracker, monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("ray", reason="brings psutil")
    pytest.importorskip("psutil", reason="measures the load")
    monkeypatch.setenv(ASKED, "true")
    monkeypatch.setenv("MLFLOW_SYSTEM_METRICS_SAMPLING_INTERVAL", "0.2")
    assert "system/cpu_utilization_percentage" in metrics(tracked, "system/")
    assert tracked._unwatch is None


def test_nothing_is_measured_unless_it_is_asked_for(tracked: Tracker, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv(ASKED, raising=False)
    assert metrics(tracked, "") == set()
    assert system_metrics.watch("sqlite://", "run") is system_metrics._nothing
