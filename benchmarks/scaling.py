"""The overhead of a sweep: `python -m benchmarks.scaling [--cells N ...] [--json]`.

Two measurements, each in a separate process, on one worker per CPU:
  overhead   1,000 cells of about 50 ms: the share of the wall time that is their work
  no-op      N cells that do nothing: planning, running, tables, MLflow and status, and the driver's memory
"""

from __future__ import annotations

import argparse
import json
import os
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from benchmarks.cell_length import episodes_of

SEEDS = 10

WORK_SECONDS = 0.05
"""Length of the cells for measuring the overhead."""


def space(cells: int, episodes: int) -> dict[str, Any]:
    """Return a search space of `cells` cells of Q-learning, in configurations of SEEDS."""
    rates = [round(0.05 + 0.9 * number / cells, 9) for number in range(max(1, cells // SEEDS))]
    return {
        "schema": 1,
        "name": "scaling",
        "seeds": SEEDS,
        "scenarios": [
            {"source": {"task": "windy_gridworld", "kinds": ["exact"]}, "targets": ["windy_gridworld:wind=reversed"]}
        ],
        "agents": {"q_learning": {"learning_rate": rates}},
        "hyperparameters": {"episodes": [episodes], "evaluate_every": [max(1, episodes // 4)]},
    }


def measure(cells: int, length: float) -> dict[str, float]:
    """Run a sweep of cells of `length` seconds (0: one episode); return seconds per part, and peak memory in MiB."""
    from orchestrator.process_env import prepare

    prepare()
    from rich.console import Console

    from deltatune.publish import publish
    from orchestrator.cluster.connection import connected
    from orchestrator.cluster.resources import Resources
    from orchestrator.execution.settings import Settings
    from orchestrator.execution.sweep import run
    from orchestrator.results.status import sweep_status
    from orchestrator.results.sweep_folder import Results
    from orchestrator.tracking.mlflow.mirror import Mirror
    from orchestrator.tracking.sync import sync
    from search_spaces.loading import parse

    seconds: dict[str, float] = {}

    def timed(name: str, work: Callable[[], Any]) -> Any:
        started = time.perf_counter()
        result = work()
        seconds[name] = time.perf_counter() - started
        return result

    with tempfile.TemporaryDirectory(prefix="deltatune-scaling-") as folder:
        with connected(None, None, Resources()):
            found = episodes_of(length, lambda number: space(20 * SEEDS, number), Path(folder))  # and warms
            wanted = timed("read", lambda: parse("scaling", space(cells, found)))
            results = Results.create(Path(folder), "scaling", wanted)
            tally = timed("run", lambda: run(results, Settings(), Console(quiet=True)))
        assert (tally.ran, tally.failed) == (cells, 0)
        timed("tables", results.write_tables)
        published = timed("publish", lambda: publish(results))
        uri = f"sqlite:///{folder}/mlflow.db"
        timed("leaderboard", lambda: Mirror(results, uri).write_configurations(published.findings))
        timed("mlflow", lambda: sync(published.findings, uri, []))
        seconds["mlflow"] += seconds["leaderboard"]
        timed("status", lambda: sweep_status(Results.open(Path(folder), "scaling")))
        timed("again", lambda: run(Results.open(Path(folder), "scaling"), Settings(), Console(quiet=True)))
    memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    return {"cells": cells, "workers": tally.workers, "work": tally.training_seconds, **seconds, "driver_mib": memory}


def in_a_process(cells: int, length: float) -> dict[str, float]:
    """Run `measure` in a new process."""
    command = [sys.executable, "-m", "benchmarks.scaling", "--measure", str(cells), str(length)]
    output = subprocess.run(command, stdout=subprocess.PIPE, text=True, check=True).stdout
    found: dict[str, float] = json.loads(output.splitlines()[-1])
    return found


def main() -> None:
    """Measure, and print a table or JSON."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--cells", type=int, nargs="*", default=[1000, 3000, 10000], help="sizes of the no-op sweeps")
    parser.add_argument("--json", action="store_true")
    parser.add_argument("--measure", nargs=2, type=float, help=argparse.SUPPRESS)
    args = parser.parse_args()
    if args.measure:
        print(json.dumps(measure(int(args.measure[0]), args.measure[1])))
        return
    work = in_a_process(1000, WORK_SECONDS)
    work["efficiency"] = work["work"] / work["workers"] / work["run"]
    nothing = [in_a_process(cells, 0.0) for cells in args.cells]
    if args.json:
        print(json.dumps({"overhead": work, "no-op": nothing, "load": os.getloadavg()[0]}, indent=1))
        return
    print(f"1,000 cells of {work['work']:.0f} ms: {work['run']:.1f} s on {work['workers']:.0f} workers,")
    print(f"  {work['efficiency']:.0%} of it their work")
    names = ("read", "run", "tables", "publish", "leaderboard", "mlflow", "status", "again", "driver_mib")
    print("cells   " + "".join(f"{name:>12}" for name in names))
    for row in nothing:
        print(f"{row['cells']:<8.0f}" + "".join(f"{row[name]:>12.1f}" for name in names))


if __name__ == "__main__":
    main()
