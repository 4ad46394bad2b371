"""What the tests share: one Ray for the whole session, and small finished sweeps to read from; and who runs which."""

from __future__ import annotations

import gc
import os
import shutil
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import Any

import hypothesis
import pandas as pd
import pytest
from _pytest.nodeid import NodeId
from filelock import FileLock

from orchestrator.execution.settings import Settings
from orchestrator.process_env import prepare
from tests.small_figures import small_figures
from trainables.training import throughput

prepare()
hypothesis.settings.register_profile("deltatune", deadline=None)  # a busy machine is no failure
hypothesis.settings.load_profile("deltatune")

LOCAL = Settings(local=True, workers=1)
"""Without Ray, in this process: for all whose subject is not Ray."""

SPACE = {
    "schema": 1,
    "name": "small",
    "family": "tests",
    "seeds": 2,
    "scenarios": [
        {
            "source": {
                "task": "windy_gridworld",
                "kinds": ["learned", "exact"],
                "hyperparameters": {"learning_rate": [0.5, 0.1]},
            },
            "targets": ["windy_gridworld:wind=small", "windy_gridworld:wind=reversed"],
        }
    ],
    "hyperparameters": {"episodes": [60]},
    "agents": {"q_learning": {}, "policy_reuse": {}, "delta_gate": {"threshold": [10.0, 3.0]}},
}
"""4 cells of the source stage and 28 of the transfer stage, of a few milliseconds each."""

CELLS = 4 + 2 * (2 + 4 + 8)

GROUPS = 2 + 2 * (1 + 2 + 4)
"""Its configurations."""

LONGER = {"hyperparameters": {"episodes": [1500], "evaluate_every": [50]}}
"""Makes the cells of SPACE some tenths of a second long."""

DEEP: dict[str, Any] = {
    "scenarios": [
        {
            "source": {"task": "cartpole", "agent": "dqn", "hyperparameters": {"learning_rate": [0.001]}},
            "targets": ["cartpole:gravity=5x"],
        }
    ],
    "agents": {"dqn": {}, "delta_es": {}},
    "hyperparameters": {"episodes": [300], "evaluate_every": [20], "evaluation_episodes": [5], "hidden_size": [32]},
}
"""6 cells of some seconds, with checkpoints."""


def record_lines(results: Any) -> list[bytes]:
    """The lines of a sweep's record log, in order."""
    return [line for path in sorted(results.log.folder.glob("*.jsonl")) for line in path.read_bytes().splitlines(True)]


def set_record_lines(results: Any, lines: Iterable[bytes]) -> None:
    """Replace a sweep's record log."""
    for path in results.log.folder.glob("*.jsonl"):
        path.unlink()
    (results.log.folder / "000000.jsonl").write_bytes(b"".join(lines))


def timeless(table: pd.DataFrame) -> pd.DataFrame:
    """A table without the columns that are never the same twice."""
    return table.drop(columns=["seconds", "steps_per_second"], errors="ignore")


LONG = (
    "test_cluster",
    "ray",
    "test_mlflow_ui",
    "test_driver",
    "test_workers",
    "test_mlflow_mirror",
    "test_mlflow",
    "test_remote",
    "test_kill",
    "test_two_sweeps",
    "test_executors",
    "test_browser",
    "test_mlflow_registry",
    "test_extending",
    "test_cli",
    "test_confirmation",
    "test_sequential_seeds",
    "test_sections",
    "test_mutations",
    "test_fuzz",
    "test_importance",
    "test_custom_sweep",
    "test_bad_input",
    "test_interface",
    "test_answers",
    "test_metric_validity",
    "test_figures",
    "test_update_speed",
    "test_simulation",
    "test_every_space",
    "test_confirmed_figures",
    "test_longer",
    "test_oracle",
    "test_formats",
    "test_dqn",
    "test_sources",
    "test_reproduction",
    "test_mlflow_store",
    "test_reuse",
    "test_source_ranking",
    "test_contrast_command",
    "test_old_formats",
    "test_custom_files",
    "test_manage",
    "test_streams",
    "test_over_tasks",
    "test_lock",
    "test_play",
    "test_early_stopping",
    "test_forecast",
    "test_dataset",
    "test_play_command",
    "test_end_states",
    "test_exact_delta",
    "test_mlflow_inputs",
    "test_bench",
    "test_published",
    "test_double_dqn",
    "test_mutated_sources",
    "test_system_metrics",
)
"""Groups of tests that take longest: they begin first, in this order, and `make test-fast` leaves them out."""

APART = {"test_every_space", "test_simulation"}
"""Modules whose tests share nothing that is dear to make."""


def _group(item: pytest.Item) -> str:
    """Return the name of the tests that one process of pytest-xdist runs, one after the other.

    Those of a module, which share its fixtures; and those that share this session's Ray.
    """
    if "ray_session" in getattr(item, "fixturenames", ()) or item.get_closest_marker("ray"):
        return "ray"
    name = item.path.stem
    return f"{name}:{item.name}" if name in APART else name


def _name_group(item: pytest.Item, group: str) -> None:
    """Append the group to a test's name, where pytest-xdist reads it.

    It would do so itself for the mark `xdist_group`, but pytest 9.2 ignores the name that xdist 3.8 changes, and
    every test would be a group of its own: module fixtures and Ray would start once in each process.
    """
    item._id = NodeId.parse(f"{item.nodeid}@{group}")


def pytest_collection_finish() -> None:
    """Let the garbage collector pass over what was imported, and come less often."""
    gc.collect()
    gc.freeze()
    gc.set_threshold(10_000, 10, 10)


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Mark the tests that use this session's Ray and those that take long; group all, and put the long groups first."""
    places = {}
    for item in items:
        if "ray_session" in getattr(item, "fixturenames", ()):
            item.add_marker("ray")
        group = _group(item)
        if getattr(item.config.option, "loadgroup", False):
            _name_group(item, group)
        name = group.partition(":")[0]
        places[item] = LONG.index(name) if name in LONG else len(LONG)
        if name in LONG:
            item.add_marker("long")
    items.sort(key=places.__getitem__)


@pytest.fixture(autouse=True)
def _own_mlflow(monkeypatch: pytest.MonkeyPatch) -> None:
    """No test writes to a store that the environment names."""
    monkeypatch.delenv("MLFLOW_TRACKING_URI", raising=False)
    monkeypatch.delenv("DELTATUNE_STORAGE", raising=False)


@pytest.fixture(autouse=True)
def _short_measurements(monkeypatch: pytest.MonkeyPatch) -> None:
    """A forecast measures an agent's speed for a second: no test needs it that exact."""
    monkeypatch.setattr(throughput, "SECONDS", 0.02)


@pytest.fixture(scope="session")
def ray_session() -> Iterator[None]:
    """Ray on two CPUs, started once; sweeps in this process use it as it is."""
    import ray

    ray.init(address="local", num_cpus=2, include_dashboard=False, log_to_driver=False, logging_level="ERROR")
    yield
    ray.shutdown()


def made_once(factory: pytest.TempPathFactory, name: str, make: Callable[[Path], None]) -> Path:
    """Return the folder `name` that `make` has filled, once for all processes of this run of the tests."""
    root = factory.getbasetemp()
    folder = (root.parent if "PYTEST_XDIST_WORKER" in os.environ else root) / f"shared-{name}"
    with FileLock(f"{folder}.lock"):
        if not (whole := folder.with_suffix(".whole")).exists():
            shutil.rmtree(folder, ignore_errors=True)
            folder.mkdir()
            make(folder)
            whole.touch()
    return folder


@pytest.fixture(scope="session")
def finished(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The storage folder of a finished sweep called `small`. Read it; copy it before you change anything."""
    return made_once(tmp_path_factory, "finished", lambda folder: _sweep(folder, CELLS))


@pytest.fixture(scope="session")
def calm(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """As `finished`, with cells that are LONGER."""
    return made_once(tmp_path_factory, "calm", lambda folder: _sweep(folder, CELLS, **LONGER))


@pytest.fixture(scope="session")
def calm_deep(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """As `finished`, of DEEP."""
    return made_once(tmp_path_factory, "calm-deep", lambda folder: _sweep(folder, 6, **DEEP))


@pytest.fixture
def quick_figures() -> Iterator[None]:
    """As `small_figures`: for tests of what is in a report, and not of how its figures look."""
    with small_figures():
        yield


@pytest.fixture(scope="module")
def quick_mlflow(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    """Copy new MLflow databases from one that was made once: MLflow takes a second of computing to make one."""
    from orchestrator.tracking.mlflow import store

    make = store.make
    made = made_once(tmp_path_factory, "mlflow", lambda folder: make(folder / "mlflow.db")) / "mlflow.db"

    def copied(path: Path) -> None:
        if not (path.exists() and path.stat().st_size):
            path.parent.mkdir(parents=True, exist_ok=True)
            shutil.copyfile(made, path)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(store, "make", copied)
        yield


def _sweep(storage: Path, cells: int, **changes: Any) -> None:
    from rich.console import Console

    from orchestrator.execution.sweep import run
    from orchestrator.results.sweep_folder import Results
    from search_spaces.loading import parse

    results = Results.create(storage, "small", parse("small", SPACE | changes))
    tally = run(results, LOCAL, Console(quiet=True))
    assert (tally.ran, tally.failed) == (cells, 0)
    results.write_tables()
