"""What recording in MLflow costs a sweep: `python -m benchmarks.tracking_cost [--episodes N] [--json]`.

200 cells of the paper's gate, each with 51 points of 6 curves and 8 final figures (314 metrics), without MLflow, with
a sqlite store, with a server on loopback, and with a server that is dead for the middle third of the cells. The sweeps
run in turn on one Ray, the first one twice, so that the noise of the machine shows.
"""

from __future__ import annotations

import argparse
import contextlib
import json
import os
import signal
import socket
import subprocess
import sys
import tempfile
import time
import urllib.request
from collections.abc import Callable
from pathlib import Path
from typing import Any

CELLS, POINTS = 200, 50


def space(episodes: int) -> dict[str, Any]:
    """CELLS cells of the paper's gate with an exact source."""
    targets = ["windy_gridworld:wind=small", "windy_gridworld:wind=reversed"]
    return {
        "schema": 1,
        "name": "cost",
        "seeds": CELLS // len(targets),
        "scenarios": [{"source": {"task": "windy_gridworld", "kinds": ["exact"]}, "targets": targets}],
        "agents": {"delta_gate": {"threshold": [3.0]}},
        "hyperparameters": {"episodes": [episodes], "evaluate_every": [episodes // POINTS]},
    }


class Server:
    """`mlflow server` with a database, on loopback."""

    def __init__(self, folder: Path) -> None:
        with socket.socket() as probe:
            probe.bind(("127.0.0.1", 0))
            self._port = str(probe.getsockname()[1])
        self.uri = f"http://127.0.0.1:{self._port}"
        self._store = f"sqlite:///{folder}/server.db"
        self._process: subprocess.Popen[bytes] | None = None

    def start(self, wait: bool = True) -> None:
        """Start it, and wait until it answers."""
        words = ["server", "--backend-store-uri", self._store, "--workers", "1", "--host", "127.0.0.1"]
        self._process = subprocess.Popen(
            [sys.executable, "-m", "mlflow", *words, "--port", self._port],
            env=os.environ | {"MLFLOW_SERVER_ENABLE_JOB_EXECUTION": "false"},
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            start_new_session=True,
        )
        while wait and not self._answers():
            time.sleep(0.2)

    def kill(self) -> None:
        """End it at once."""
        assert self._process is not None
        os.killpg(self._process.pid, signal.SIGKILL)
        self._process.wait()

    def _answers(self) -> bool:
        with contextlib.suppress(OSError), urllib.request.urlopen(f"{self.uri}/health", timeout=2) as answer:
            return bool(answer.status == 200)
        return False


def sweep(folder: Path, episodes: int, uri: str | None, harm: Callable[[int], None] = lambda n: None) -> dict[str, Any]:
    """Run the sweep: seconds of it, and of what MLflow takes after its end; runs there."""
    from rich.console import Console

    from orchestrator.results import Results
    from orchestrator.settings import Settings
    from orchestrator.sweep import run
    from orchestrator.tracker import Tracker
    from search_spaces import parse

    results = Results.create(folder, "cost", parse("cost", space(episodes)))
    tracker = Tracker(results, uri) if uri else None
    seen = 0

    def told(stage: str, record: Any) -> None:
        nonlocal seen
        seen += 1
        harm(seen)
        if tracker:
            tracker.record(stage, record)

    started = time.perf_counter()
    tally = run(results, Settings(), Console(quiet=True), told)
    ran = time.perf_counter()
    if tracker and tracker.finish([]) is None:
        raise RuntimeError(f"MLflow has not got everything: {tracker.error}")
    after = time.perf_counter() - ran
    return {"run": ran - started, "after": after, "cell": tally.training_seconds / CELLS, "runs": runs(uri)}


def runs(uri: str | None) -> int:
    """Finished runs of cells in a store."""
    if uri is None:
        return 0
    from mlflow.tracking import MlflowClient

    client = MlflowClient(uri)
    experiment = client.get_experiment_by_name("deltatune/cost")
    found = client.search_runs([experiment.experiment_id], "tags.kind = 'cell'", max_results=1000)
    return sum(run.info.status == "FINISHED" for run in found)


def measure(episodes: int) -> dict[str, dict[str, Any]]:
    """All of them, in turn."""
    from orchestrator.cluster import connected
    from orchestrator.settings import Resources

    with tempfile.TemporaryDirectory(prefix="deltatune-cost-") as name, connected(None, None, Resources()):
        folder = Path(name)
        found = {"none": sweep(folder / "a", episodes, None), "none again": sweep(folder / "b", episodes, None)}
        found["sqlite"] = sweep(folder / "c", episodes, f"sqlite:///{folder}/own.db")
        for number, killed in enumerate((False, True)):
            (folder / f"server{number}").mkdir()
            server = Server(folder / f"server{number}")
            server.start()

            def harm(cells: int, server: Server = server, killed: bool = killed) -> None:
                if killed and cells == CELLS // 3:
                    server.kill()
                if killed and cells == 2 * CELLS // 3:
                    server.start(wait=False)

            found["server killed" if killed else "server"] = sweep(folder / f"d{number}", episodes, server.uri, harm)
            server.kill()
    return found


def main() -> None:
    """Measure, and print a table or JSON."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--episodes", type=int, default=20000, help="of a cell: how long it is")
    parser.add_argument("--json", action="store_true")
    asked = parser.parse_args()
    from orchestrator.environment import prepare

    prepare()
    found = measure(asked.episodes)
    if asked.json:
        print(json.dumps(found, indent=1))
        return
    base = min(found["none"]["run"], found["none again"]["run"])
    print(f"{CELLS} cells of {found['none']['cell']:.2f} s")
    for name, row in found.items():
        cost = row["run"] / base - 1
        print(f"{name:14} {row['run']:7.1f} s  {cost:+6.1%}  after the end {row['after']:5.1f} s  {row['runs']} runs")


if __name__ == "__main__":
    main()
