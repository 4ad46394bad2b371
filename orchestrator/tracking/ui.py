"""The MLflow UI on a storage folder."""

from __future__ import annotations

import os
import signal
import subprocess
import sys

from rich.console import Console

from orchestrator.tracking.mlflow.experiment import FAMILY
from orchestrator.tracking.mlflow.store import connect
from orchestrator.tracking.mlflow.views import LEADERBOARD

TRAINING = "workflowType=machine_learning"
"""Part of the address of MLflow's pages for training runs."""


def serve(uri: str, host: str, port: int, console: Console) -> int:
    """Serve the MLflow UI of the store `uri` until it is stopped; return its exit code.

    It has one worker and no job runner, which takes a third of the memory and half of the start-up time of MLflow's
    defaults. A database's address may hold a password, so it is passed by the environment and not on a command line.
    """
    if uri.startswith(("http://", "https://")):
        console.print(f"The tracking server has its own UI: {uri}", soft_wrap=True)
        return 0
    environment = os.environ | {"MLFLOW_SERVER_ENABLE_JOB_EXECUTION": "false", "MLFLOW_BACKEND_STORE_URI": uri}
    command = [sys.executable, "-m", "mlflow", "server", "--workers", "1"]
    pages = leaderboards(uri)
    for name, path in pages.items():
        console.print(f"{name}: http://{host}:{port}/{path}", soft_wrap=True)
    page = "" if pages else f"http://{host}:{port}/#/experiments?{TRAINING} "
    console.print(f"MLflow UI: {page}(it takes a few seconds; Ctrl-C stops it)", soft_wrap=True)
    signal.signal(signal.SIGTERM, signal.default_int_handler)  # else the server would outlive this process
    with subprocess.Popen([*command, "--host", host, "--port", str(port)], env=environment) as server:
        try:
            return server.wait()
        except KeyboardInterrupt:
            server.terminate()
            return 0


def leaderboards(uri: str) -> dict[str, str]:
    """Return the path of each experiment's leaderboard by the experiment's name, the latest first.

    The link selects the page of training runs; otherwise MLflow opens its page for generative AI.
    """
    found = connect(uri).search_experiments(filter_string=f"name LIKE '{FAMILY}%'", order_by=["last_update_time DESC"])
    key = LEADERBOARD.key
    return {
        f"Leaderboard of {experiment.name.removeprefix(FAMILY)}": (
            f"#/experiments/{experiment.experiment_id}/runs?{TRAINING}&viewStateShareKey={key}"
        )
        for experiment in found
    }
