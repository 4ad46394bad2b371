"""The driver is killed in the middle of a sweep: the same command again runs what is missing, and no more."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from collections import Counter
from pathlib import Path

import pandas as pd
import pytest
import yaml
from conftest import CELLS, GROUPS, LONGER, SPACE, timeless
from mlflow.tracking import MlflowClient

from orchestrator.results.sweep_folder import Results
from tests.deltatune.cli import in_process

ENOUGH = 6
"""Cells to wait for before the kill."""


def command(space: Path, storage: Path) -> list[str]:
    words = ["sweep", str(space), "--storage", str(storage), "--local", "--workers", "2", "--json"]
    return [sys.executable, "-m", "deltatune.cli.main", *words]


@pytest.mark.slow
@pytest.mark.usefixtures("quick_figures")
def test_a_killed_sweep_goes_on_with_its_missing_cells(calm: Path, tmp_path: Path) -> None:
    space = tmp_path / "space.yaml"
    space.write_text(yaml.safe_dump(SPACE | LONGER, sort_keys=False))
    with subprocess.Popen(command(space, tmp_path), stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL) as driver:
        deadline = time.monotonic() + 240
        while ended(tmp_path) < ENOUGH:
            assert driver.poll() is None, "the sweep ended before it could be killed"
            assert time.monotonic() < deadline, "no cell ended"
            time.sleep(0.05)
        os.kill(driver.pid, signal.SIGKILL)
    there = ended(tmp_path)
    assert ENOUGH <= there < CELLS
    code, out, err = in_process.command(
        "sweep", str(space), "--storage", str(tmp_path), "--local", "--workers=1", "--json"
    )
    assert code == 0, err
    tally = json.loads(out)["tally"]
    assert (tally["reused"], tally["ran"]) == (there, CELLS - there)
    for name in ("cells", "points"):
        tables = [pd.read_parquet(folder / "small" / f"{name}.parquet") for folder in (tmp_path, calm)]
        pd.testing.assert_frame_equal(
            *(timeless(table) for table in tables),
            check_exact=True,
        )
    runs = mlflow_runs(tmp_path)
    assert set(runs.values()) == {1}
    assert Counter(kind for kind, _ in runs) == {"cell": CELLS, "aggregate": GROUPS, "sweep": 1}


@pytest.mark.slow
def test_a_killed_deep_sweep_goes_on_from_its_checkpoints(tmp_path: Path) -> None:
    space = tmp_path / "space.yaml"
    values = {"episodes": [400], "evaluate_every": [20], "evaluation_episodes": [5], "hidden_size": [32]}
    source = {"task": "cartpole", "agent": "dqn", "hyperparameters": {"learning_rate": [0.001]}}
    scenarios = [{"source": source, "targets": ["cartpole:gravity=5x"]}]
    space.write_text(
        yaml.safe_dump(
            SPACE | {"scenarios": scenarios, "agents": {"dqn": {}, "delta_es": {}}, "hyperparameters": values}
        )
    )
    killed, calm = tmp_path / "killed", tmp_path / "calm"
    words = [*command(space, killed), "--checkpoint-every", "0", "--no-mlflow"]
    with subprocess.Popen(words, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL) as driver:
        deadline = time.monotonic() + 240
        while not list(killed.glob("small/checkpoints/[0-9a-f]*.checkpoint")):
            assert driver.poll() is None, "the sweep ended before it could be killed"
            assert time.monotonic() < deadline, "no checkpoint was made"
            time.sleep(0.05)
        os.kill(driver.pid, signal.SIGKILL)
    subprocess.run(words, capture_output=True, check=True)
    assert not list(killed.glob("small/checkpoints/*"))
    subprocess.run([*command(space, calm), "--no-mlflow"], capture_output=True, check=True)
    tables = [timeless(pd.read_parquet(folder / "small" / "points.parquet")) for folder in (killed, calm)]
    pd.testing.assert_frame_equal(*tables, check_exact=True)


def ended(storage: Path) -> int:
    """Cells of the sweep that have ended."""
    folder = storage / "small"
    return len(Results(folder).heads()) if (folder / "sweep.json").exists() else 0


def mlflow_runs(storage: Path) -> Counter[tuple[str, str]]:
    """How many finished runs there are of each cell and group."""
    client = MlflowClient(f"sqlite:///{storage / 'mlflow.db'}")
    experiment = client.get_experiment_by_name("deltatune/tests")
    assert experiment is not None
    runs = client.search_runs([experiment.experiment_id], max_results=1000)
    assert {run.info.status for run in runs} == {"FINISHED"}
    return Counter(
        (run.data.tags["kind"], run.data.tags.get("cell_id") or run.data.tags.get("group", "")) for run in runs
    )
