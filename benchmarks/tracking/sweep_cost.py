"""The cost of recording a sweep in MLflow: `python -m benchmarks.tracking.sweep_cost [--seconds S] [--json]`.

200 cells of the paper's gate, each with 45 points of 7 curves and its final figures (over 320 metrics), with an SQLite
store, with a server on loopback, and with a server that is down for the middle third of the cells. Everything shares
this machine's cores, the server too. Before, between and after them the same sweep runs without MLflow: the median of
these runs is the reference, and their range shows the noise.
"""

from __future__ import annotations

import argparse
import json
import statistics
import tempfile
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

from benchmarks.cell_length import episodes_of
from benchmarks.tracking.server import TrackingServer

CELLS, POINTS = 200, 44


def space(episodes: int, cells: int = CELLS) -> dict[str, Any]:
    """Return a search space of `cells` cells of the paper's gate with an exact source."""
    targets = ["windy_gridworld:wind=small", "windy_gridworld:wind=reversed"]
    return {
        "schema": 1,
        "name": "cost",
        "seeds": cells // len(targets),
        "scenarios": [{"source": {"task": "windy_gridworld", "kinds": ["exact"]}, "targets": targets}],
        "agents": {"delta_gate": {"threshold": [3.0]}},
        "hyperparameters": {"episodes": [episodes], "evaluate_every": [episodes // POINTS]},
    }


def sweep(
    folder: Path,
    episodes: int,
    uri: str | None,
    harm: Callable[[int], None] = lambda number: None,
    ready: Callable[[], None] = lambda: None,
) -> dict[str, Any]:
    """Run the sweep; return its seconds, those of MLflow after its end, and the numbers of runs and metrics.

    harm: called with the number of ended cells. ready: waits after the run, in no figure, until MLflow answers.
    """
    from rich.console import Console

    from orchestrator.analysis.findings import find
    from orchestrator.execution.settings import Settings
    from orchestrator.execution.sweep import run
    from orchestrator.results.sweep_folder import Results
    from orchestrator.tracking.tracker import Tracker
    from search_spaces.loading import parse

    results = Results.create(folder, "cost", parse("cost", space(episodes)))
    tracker = Tracker(results, uri) if uri else None
    seen = 0

    def on_cell(stage: str, record: Any) -> None:
        nonlocal seen
        seen += 1
        harm(seen)
        if tracker:
            tracker.record(stage, record)

    started = time.perf_counter()
    tally = run(results, Settings(), Console(quiet=True), on_cell)
    ran = time.perf_counter() - started
    ready()
    begun = time.perf_counter()
    if tracker and tracker.finish(find(results), []) is None:
        raise RuntimeError(f"MLflow is incomplete: {tracker.error}")
    after = time.perf_counter() - begun
    return {"run": ran, "after": after, "cell": tally.training_seconds / CELLS} | (there(uri) if uri else {})


def there(uri: str) -> dict[str, int]:
    """Return the number of finished cell runs in a store, and of the metrics of one."""
    from mlflow.tracking import MlflowClient

    client = MlflowClient(uri)
    experiment = client.get_experiment_by_name("deltatune/cost")
    found = client.search_runs([experiment.experiment_id], "tags.kind = 'cell'", max_results=1000)
    one = found[0]
    metrics = sum(len(client.get_metric_history(one.info.run_id, name)) for name in one.data.metrics)
    return {"runs": sum(run.info.status == "FINISHED" for run in found), "metrics": metrics}


def measure(seconds: float) -> Iterator[tuple[str, dict[str, Any]]]:
    """Yield the result of each run when it is done."""
    from orchestrator.cluster.connection import connected
    from orchestrator.cluster.resources import Resources

    with tempfile.TemporaryDirectory(prefix="deltatune-cost-") as name, connected(None, None, Resources()):
        folder = Path(name)
        episodes = episodes_of(seconds, lambda number: space(number, 20), folder)
        yield "none", sweep(folder / "none0", episodes, None)
        yield "sqlite", sweep(folder / "sqlite", episodes, f"sqlite:///{folder}/own.db")
        yield "none", sweep(folder / "none1", episodes, None)
        yield "server", with_server(folder / "server", episodes, killed=False)
        yield "none", sweep(folder / "none2", episodes, None)
        yield "server killed", with_server(folder / "killed", episodes, killed=True)
        yield "none", sweep(folder / "none3", episodes, None)


def with_server(folder: Path, episodes: int, killed: bool) -> dict[str, Any]:
    """Run the sweep with a server, which may be `killed` for the middle third of the cells."""
    folder.mkdir()
    server = TrackingServer(folder)
    server.start()

    def harm(cells: int) -> None:
        if killed and cells == CELLS // 3:
            server.kill()
        if killed and cells == 2 * CELLS // 3:
            server.start(wait=False)

    try:
        return sweep(folder, episodes, server.uri, harm, server.wait)
    finally:
        server.kill()


def main() -> None:
    """Measure, and print a table or JSON."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--seconds", type=float, default=0.5, help="of a cell")
    parser.add_argument("--json", action="store_true")
    args = parser.parse_args()
    from orchestrator.process_env import prepare

    prepare()
    found = list(measure(args.seconds))
    if args.json:
        print(json.dumps(found, indent=1))
        return
    without = [row["run"] for name, row in found if name == "none"]
    base = statistics.median(without)
    print(f"{CELLS} cells of {found[0][1]['cell']:.2f} s; without MLflow {min(without):.1f} to {max(without):.1f} s")
    for name, row in found:
        if name != "none":
            print(f"{name:14} {row['run']:7.1f} s  {row['run'] / base - 1:+6.1%}", end="  ")
            print(f"after the end {row['after']:5.1f} s  {row['runs']} runs of {row['metrics']} metrics")


if __name__ == "__main__":
    main()
