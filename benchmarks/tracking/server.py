"""An MLflow server on loopback that can be killed and started again at the same address."""

from __future__ import annotations

import contextlib
import os
import signal
import socket
import subprocess
import sys
import time
import urllib.request
from pathlib import Path

PATIENCE = 120.0
"""Seconds after which a server that does not answer counts as broken."""


class TrackingServer:
    """`mlflow server` with one worker and a database in `folder`."""

    def __init__(self, folder: Path) -> None:
        with socket.socket() as probe:
            probe.bind(("127.0.0.1", 0))
            port = str(probe.getsockname()[1])
        self.folder, self.uri = folder, f"http://127.0.0.1:{port}"
        self._words = ["--backend-store-uri", f"sqlite:///{folder}/server.db", "--host", "127.0.0.1", "--port", port]
        self._words += ["--artifacts-destination", str(folder / "artifacts"), "--workers", "1"]
        self._process: subprocess.Popen[bytes] | None = None

    def start(self, wait: bool = True) -> None:
        """Start it, and `wait` until it answers. Raises TimeoutError after PATIENCE."""
        self._process = subprocess.Popen(
            [sys.executable, "-m", "mlflow", "server", *self._words],
            env=os.environ | {"MLFLOW_SERVER_ENABLE_JOB_EXECUTION": "false"},
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            start_new_session=True,
        )
        if wait:
            self.wait()

    def wait(self) -> None:
        """Wait until it answers. Raises TimeoutError after PATIENCE."""
        until = time.monotonic() + PATIENCE
        while not self._answers():
            if time.monotonic() > until:
                self.kill()
                raise TimeoutError(f"the MLflow server at {self.uri} does not answer")
            time.sleep(0.2)

    def kill(self) -> None:
        """Kill it and its processes; does nothing if it is dead."""
        if self._process is not None:
            with contextlib.suppress(ProcessLookupError):
                os.killpg(self._process.pid, signal.SIGKILL)
            self._process.wait()
            self._process = None

    def _answers(self) -> bool:
        with contextlib.suppress(OSError), urllib.request.urlopen(f"{self.uri}/health", timeout=2) as answer:
            return bool(answer.status == 200)
        return False
