"""MLflow's processor time for a cell, call by call: `python -m benchmarks.tracking.cell_cost [--cells N] [--json]`.

Cells of the paper's gate with 501 points, written after their sweep to an SQLite store. The floor is the same three
calls for runs with a single number, in turn, so that noise affects both alike.
"""

from __future__ import annotations

import argparse
import json
import tempfile
import time
from collections import defaultdict
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import Any

from benchmarks.tracking.sweep_cost import space

CALLS = ("create_run", "log_batch", "set_terminated")
EPISODES = 500


def measure(cells: int) -> dict[str, Any]:
    """Return milliseconds of processor time per cell: `cell` in all, each of CALLS, `floor`; and a run's metrics."""
    from mlflow.tracking import MlflowClient
    from rich.console import Console

    from orchestrator.execution.settings import Settings
    from orchestrator.execution.sweep import run
    from orchestrator.results.sweep_folder import Results
    from orchestrator.tracking.mlflow.mirror import Mirror
    from search_spaces.loading import parse

    spec = space(EPISODES, cells) | {"hyperparameters": {"episodes": [EPISODES], "evaluate_every": [1]}}
    spent: dict[str, float] = defaultdict(float)
    with tempfile.TemporaryDirectory(prefix="deltatune-cost-") as folder:
        results = Results.create(Path(folder), "cost", parse("cost", spec))
        run(results, Settings(local=True, workers=1), Console(quiet=True))
        uri = f"sqlite:///{folder}/mlflow.db"
        mirror, client = Mirror(results, uri), MlflowClient(uri)
        experiment = client.create_experiment("floor")
        _empty(client, experiment)
        for stage, cell, head in results.planned_heads():
            assert head is not None
            begun = time.process_time()
            _empty(client, experiment)
            started = time.process_time()
            with _timed(MlflowClient, spent):
                mirror.write_cell(stage, head, partial(results.log.record, cell.id))
            spent["floor"] += started - begun
            spent["cell"] += time.process_time() - started
    return {"cells": cells, **{name: round(1000 * seconds / cells, 2) for name, seconds in spent.items()}}


def _empty(client: Any, experiment: str) -> None:
    """Write an empty run, by the same calls as a cell's run."""
    from mlflow.entities import Metric

    made = client.create_run(experiment)
    client.log_batch(made.info.run_id, [Metric("auc", 0.0, 0, 0)])
    client.set_terminated(made.info.run_id)


@contextmanager
def _timed(client: type[Any], spent: dict[str, float]) -> Iterator[None]:
    """Add up the processor time of CALLS."""
    before = {name: getattr(client, name) for name in CALLS}

    def timed(name: str, call: Callable[..., Any]) -> Callable[..., Any]:
        def work(*given: Any, **named: Any) -> Any:
            started = time.process_time()
            try:
                return call(*given, **named)
            finally:
                spent[name] += time.process_time() - started

        return work

    for name, call in before.items():
        setattr(client, name, timed(name, call))
    try:
        yield
    finally:
        for name, call in before.items():
            setattr(client, name, call)


def main() -> None:
    """Measure, and print a line or JSON."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--cells", type=int, default=100)
    parser.add_argument("--json", action="store_true")
    args = parser.parse_args()
    from orchestrator.process_env import prepare

    prepare()
    found = measure(args.cells)
    print(json.dumps(found) if args.json else "  ".join(f"{name} {value}" for name, value in found.items()))


if __name__ == "__main__":
    main()
