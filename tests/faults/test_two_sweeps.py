"""Two sweeps of one storage at once, and somebody else in MLflow's database: nothing double, nothing lost."""

from __future__ import annotations

import sqlite3
import subprocess
import sys
import time
from collections import Counter
from pathlib import Path

import pytest
import yaml
from conftest import timeless
from harness import PATIENCE, space, sweep
from mlflow.tracking import MlflowClient

from orchestrator.results.sweep_folder import Results
from orchestrator.sources.library import SourceLibrary
from tests.deltatune.cli.in_process import command
from tests.small_figures import DRAWN_SMALL

LOCKED_SECONDS = 3.0
"""For which another process holds the database for itself."""


FEW = {"seeds": 1, "agents": {"q_learning": {}, "policy_reuse": {}}}


@pytest.mark.slow
def test_two_sweeps_of_one_storage_with_a_store_that_others_write_to(tmp_path: Path) -> None:
    """Both train the same sources, make MLflow's database at the same moment, and are synchronised while they run."""
    storage, file = tmp_path / "storage", tmp_path / "small.yaml"
    file.write_text(yaml.safe_dump(space(**FEW), sort_keys=False))
    calm, _ = sweep(tmp_path / "calm", **FEW)
    words = ["sweep", str(file), "--storage", str(storage), "--local", "--workers", "1", "--reuse", "none"]
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.STDOUT, "text": True}
    sweeps = {
        name: subprocess.Popen([sys.executable, *DRAWN_SMALL, *words, "--name", name], **pipes)  # type: ignore[call-overload]
        for name in ("one", "two")
    }
    try:
        database, deadline = storage / "mlflow.db", time.monotonic() + PATIENCE
        begun = [database, *(storage / name / "sweep.json" for name in sweeps)]
        while not all(path.exists() for path in begun) and time.monotonic() < deadline:
            time.sleep(0.01)
        with sqlite3.connect(database, timeout=PATIENCE, isolation_level=None) as other:
            other.execute("BEGIN IMMEDIATE")
            time.sleep(LOCKED_SECONDS)
            other.execute("ROLLBACK")
        other.close()
        code, _, err = command("sync", "one", "--storage", str(storage))
        assert code in (0, 2), err
        assert code == 0 or "is being written into MLflow by process" in err
        said = {name: process.communicate(timeout=PATIENCE)[0] for name, process in sweeps.items()}
    finally:
        for process in sweeps.values():
            process.kill()
            process.wait()
    assert {name: process.returncode for name, process in sweeps.items()} == {"one": 0, "two": 0}, said
    expected = timeless(calm.tables()[1])
    client = MlflowClient(f"sqlite:///{database}")
    experiment = client.get_experiment_by_name("deltatune/tests")
    assert experiment is not None
    for name in sweeps:
        assert timeless(Results.open(storage, name).tables()[1]).equals(expected)
        found = client.search_runs([experiment.experiment_id], f"tags.sweep = '{name}'", max_results=1000)
        ids = Counter(run.data.tags["cell_id"] for run in found if run.data.tags["kind"] == "cell")
        assert set(ids) == set(Results.open(storage, name).heads())
        assert set(ids.values()) == {1}, "a cell is in MLflow twice"
        assert {run.info.status for run in found} == {"FINISHED"}
        groups = Counter(run.data.tags["group"] for run in found if run.data.tags["kind"] == "aggregate")
        assert set(groups.values()) == {1}
    assert set(ids) == set(calm.heads())
    library = {entry.id: entry.knowledge.digest for entry in SourceLibrary(storage).entries()}
    assert library == {entry.id: entry.knowledge.digest for entry in SourceLibrary(calm.storage).entries()}
