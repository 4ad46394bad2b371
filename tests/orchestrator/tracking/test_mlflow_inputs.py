"""Two sweeps that log the same task at the same moment: MLflow refuses one of them, and both are whole in the end."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import pytest
from mlflow.entities import DatasetInput
from mlflow.exceptions import MlflowException
from mlflow.tracking import MlflowClient
from rich.console import Console

from orchestrator.analysis.findings import find
from orchestrator.execution import sweep as sweeps
from orchestrator.results.sweep_folder import Results
from orchestrator.tracking.sync import sync
from orchestrator.tracking.uri import tracking_uri
from tests.orchestrator.local_sweeps import LOCAL, space

pytestmark = pytest.mark.usefixtures("quick_mlflow")

log_inputs = MlflowClient.log_inputs


@pytest.fixture
def swept(tmp_path: Path) -> Results:
    results = Results.create(tmp_path, "small", space(seeds=1, agents={"q_learning": {}, "policy_reuse": {}}))
    assert sweeps.run(results, LOCAL, Console(quiet=True)).failed == 0
    return results


def refused(monkeypatch: pytest.MonkeyPatch, times: int) -> list[str]:
    """Let MLflow refuse the first `times` datasets, as its table does where another has just added one."""
    runs: list[str] = []

    def log(self: MlflowClient, run_id: str, datasets: Sequence[DatasetInput] | None = None, **more: Any) -> None:
        if datasets:
            runs.append(run_id)
            if len(runs) <= times:
                raise MlflowException("UNIQUE constraint failed: datasets.experiment_id, datasets.name")
        log_inputs(self, run_id, datasets, **more)

    monkeypatch.setattr(MlflowClient, "log_inputs", log)
    return runs


def statuses(results: Results) -> set[tuple[str, int]]:
    """Each aggregate's status, and how many datasets it has."""
    client = MlflowClient(tracking_uri(results.storage, None))
    experiment = client.get_experiment_by_name("deltatune/tests")
    assert experiment is not None
    found = client.search_runs([experiment.experiment_id], "tags.kind = 'aggregate'")
    return {(run.info.status, len(run.inputs.dataset_inputs) if run.inputs else 0) for run in found}


def test_a_dataset_that_another_sweep_has_just_added_is_logged_the_next_time(
    swept: Results, monkeypatch: pytest.MonkeyPatch
) -> None:
    runs = refused(monkeypatch, 1)
    sync(find(swept), tracking_uri(swept.storage, None), [])
    assert runs[0] == runs[1]
    assert statuses(swept) == {("FINISHED", 1), ("FINISHED", 2)}


def test_an_aggregate_that_failed_half_written_is_made_whole_by_the_next_sync(
    swept: Results, monkeypatch: pytest.MonkeyPatch
) -> None:
    uri = tracking_uri(swept.storage, None)
    with monkeypatch.context() as patch:
        refused(patch, 1000)
        with pytest.raises(MlflowException, match="UNIQUE"):
            sync(find(swept), uri, [])
    assert ("FAILED", 0) in statuses(swept)
    sync(find(swept), uri, [])
    assert statuses(swept) == {("FINISHED", 1), ("FINISHED", 2)}
