"""The Ray Tune trainable of a sweep: a worker that runs packs of cells. Light to import, since the driver does too."""

from __future__ import annotations

import json
import os
import time
from typing import Any

import ray
from ray import tune

from trainables.cell import Cell
from trainables.collector import collect_seldom
from trainables.numerics.threads import one_thread
from trainables.plugins import loader
from trainables.storage.paths import storage_path
from trainables.training.messages import Reached, Report, Started, WorkerPayload

Config = dict[str, Any]

HOLD = "hold"
"""Key of the config of a trial that only holds its worker, and of its reports."""

TIME, METRIC = "evaluations", "score"
"""Keys that `run_cells` reports for cells that run together."""


def run_cells(config: Config) -> None:
    """Run the cells of config["cells"] (see `worker.run_pack`), and report their outcomes: a sweep's trainable.

    config["cells"]: JSON. config["payload"]: a reference to the stage's WorkerPayload. config["together"]: run them
    side by side, with `evaluations` and `score` for a scheduler in the reports. Each report has the key `report`,
    which the sweep's callback processes. config["hold"], alone: hold the worker for so many seconds.
    """
    collect_seldom()
    from trainables.learners.learner import prepare
    from trainables.training.worker import StopFile, forwarded_log, run_pack

    one_thread()
    if HOLD in config:
        _hold(config[HOLD])
        return
    reference: ray.ObjectRef[WorkerPayload] = config["payload"]
    payload = ray.get(reference)
    loader.install(payload.plugins)

    def tell(report: Report) -> None:
        judged = {TIME: report.evaluations, METRIC: report.score} if isinstance(report, Reached) else {}
        tune.report({"report": report, **judged})

    given = json.loads(config["cells"])
    prepare({data["agent"] for data in given})
    tell(Started(os.getpid(), ray.get_runtime_context().get_node_id()))
    cells = [Cell.from_json(data) for data in given]
    stop = StopFile(storage_path(payload.checkpoints) if payload.checkpoints else None)
    with forwarded_log(tell) as send:
        run_pack(cells, bool(config.get("together")), payload, send, stop)


def _hold(seconds: float) -> None:
    """Do nothing for `seconds`, or until the driver ends this trial at one of its reports, which come ever rarer."""
    began = time.monotonic()
    while (waited := time.monotonic() - began) < seconds:
        tune.report({HOLD: waited})
        time.sleep(min(max(waited / 10, 0.05), 1.0))
