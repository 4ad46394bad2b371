"""What the tests share: one Ray for the whole session, and one small finished sweep to read from."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

import hypothesis
import pandas as pd
import pytest

from orchestrator.execution.settings import Settings
from orchestrator.process_env import prepare

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


RAY = {"ray", "cluster"}
"""Marks of tests that start Ray: pytest-xdist gives them all to one of its processes, beginning with them."""


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Mark the tests that use this session's Ray, and put all that start one first and together."""
    for item in items:
        if "ray_session" in getattr(item, "fixturenames", ()):
            item.add_marker("ray")
        if any(item.get_closest_marker(name) for name in RAY):
            item.add_marker(pytest.mark.xdist_group("ray"))
    items.sort(key=lambda item: item.get_closest_marker("xdist_group") is None)


@pytest.fixture(autouse=True)
def _own_mlflow(monkeypatch: pytest.MonkeyPatch) -> None:
    """No test writes to a store that the environment names."""
    monkeypatch.delenv("MLFLOW_TRACKING_URI", raising=False)
    monkeypatch.delenv("DELTATUNE_STORAGE", raising=False)


@pytest.fixture(scope="session")
def ray_session() -> Iterator[None]:
    """Ray on two CPUs, started once; sweeps in this process use it as it is."""
    import ray

    ray.init(address="local", num_cpus=2, include_dashboard=False, log_to_driver=False, logging_level="ERROR")
    yield
    ray.shutdown()


@pytest.fixture(scope="session")
def finished(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The storage folder of a finished sweep called `small`. Read it; copy it before you change anything."""
    return _swept(tmp_path_factory.mktemp("finished"), CELLS)


@pytest.fixture(scope="session")
def calm(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """As `finished`, with cells that are LONGER."""
    return _swept(tmp_path_factory.mktemp("calm"), CELLS, **LONGER)


@pytest.fixture(scope="session")
def calm_deep(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """As `finished`, of DEEP."""
    return _swept(tmp_path_factory.mktemp("calm-deep"), 6, **DEEP)


def _swept(storage: Path, cells: int, **changes: Any) -> Path:
    from rich.console import Console

    from orchestrator.execution.sweep import run
    from orchestrator.results.sweep_folder import Results
    from search_spaces.loading import parse

    results = Results.create(storage, "small", parse("small", SPACE | changes))
    tally = run(results, LOCAL, Console(quiet=True))
    assert (tally.ran, tally.failed) == (cells, 0)
    results.write_tables()
    return storage
