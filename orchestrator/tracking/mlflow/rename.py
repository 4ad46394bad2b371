"""Renames a sweep in MLflow."""

from __future__ import annotations

from mlflow.entities import RunTag

from orchestrator.results.sweep_folder import Results
from orchestrator.tracking.mlflow.experiment import FAMILY
from orchestrator.tracking.mlflow.runs import sweep_id
from orchestrator.tracking.mlflow.store import connect
from orchestrator.tracking.trackers import MLFLOW


def rename_runs(results: Results, old: str, uri: str) -> int:
    """Give the runs of a sweep that was called `old` the name of `results`, and return how many there were.

    Raises InputError where another process writes the sweep there, MLflow's errors where the store does not answer.
    """
    meta = results.meta()
    before, after = sweep_id(old, meta["created"]), sweep_id(results.name, meta["created"])
    with MLFLOW.held(results.folder):
        client = connect(uri)
        experiment = client.get_experiment_by_name(f"{FAMILY}{meta['space']['family'] or meta['space']['name']}")
        if experiment is None:
            return 0
        renamed = 0
        while runs := client.search_runs([experiment.experiment_id], f"tags.sweep_id = '{before}'", max_results=1000):
            for run in runs:
                tags = {"sweep": results.name, "sweep_id": after}
                tags |= {"mlflow.runName": results.name} if run.data.tags.get("kind") == "sweep" else {}
                client.log_batch(run.info.run_id, tags=[RunTag(name, value) for name, value in tags.items()])
                renamed += 1
        return renamed
