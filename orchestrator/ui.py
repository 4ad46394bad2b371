"""The MLflow UI on a storage folder."""

from __future__ import annotations

import os
import subprocess
import sys

from rich.console import Console


def serve(uri: str, host: str, port: int, console: Console) -> int:
    """Serve the MLflow UI of the store `uri` until it is stopped; its exit code.

    One worker and no job runner: a third of the memory and half of the start of MLflow's defaults.
    """
    if uri.startswith(("http://", "https://")):
        console.print(f"The tracking server has its own UI: {uri}")
        return 0
    environment = os.environ | {"MLFLOW_SERVER_ENABLE_JOB_EXECUTION": "false"}
    command = [sys.executable, "-m", "mlflow", "server", "--backend-store-uri", uri, "--workers", "1"]
    console.print(f"MLflow UI: http://{host}:{port} (it takes a few seconds; Ctrl-C stops it)")
    with subprocess.Popen([*command, "--host", host, "--port", str(port)], env=environment) as server:
        try:
            return server.wait()
        except KeyboardInterrupt:
            server.terminate()
            return 0
