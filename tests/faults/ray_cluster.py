"""A Ray cluster of several nodes on this machine, each of which can be switched off."""

from __future__ import annotations

import contextlib
import os
import secrets
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from pathlib import Path

START_SECONDS = 240.0
"""Seconds that a node may take to start on a busy machine."""

STARTS = 3
"""Attempts at starting a node."""

NODES = "127.0.0.2"
"""The address of all nodes but the head, by which a driver can choose one of them."""

TOKEN = os.environ | {
    "RAY_AUTH_MODE": "token",
    "RAY_AUTH_TOKEN": secrets.token_hex(32),
    "RAY_health_check_period_ms": "500",  # a node that fails five of these checks is dead
    "PATH": f"{Path(sys.executable).parent}:{os.environ['PATH']}",
}
"""The environment of the cluster, whose `python` runs its jobs, and of those who may join it."""


def free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


class Cluster:
    """A head without CPUs and nodes with one each, all by `ray start` on loopback."""

    def __init__(self, folder: Path, nodes: int = 2) -> None:
        self._folder = folder
        self.port, self.dashboard = free_port(), free_port()
        self.address, self.jobs = f"127.0.0.1:{self.port}", f"http://127.0.0.1:{self.dashboard}"
        options = ["--head", "--port", str(self.port), "--num-cpus", "0", "--include-dashboard", "true"]
        options += ["--dashboard-host", "127.0.0.1", "--dashboard-port", str(self.dashboard)]
        self.head = self._start(*options, "--temp-dir", str(folder))
        wait_for(lambda: self._listens(self.dashboard) and self._listens(self.port))
        self.nodes = [self.add_node() for _ in range(nodes)]

    def add_node(self, within: Sequence[str] = ()) -> subprocess.Popen[bytes]:
        return self._start("--address", self.address, "--num-cpus", "1", ip=NODES, within=within)

    def grow(self, nodes: int, within: Sequence[str] = ()) -> None:
        """Have at least so many nodes; new ones are started by the words `within`."""
        while len(self.nodes) < nodes:
            self.nodes.append(self.add_node(within))

    def remove(self, node: subprocess.Popen[bytes]) -> None:
        """As if the machine were switched off."""
        with contextlib.suppress(ProcessLookupError):
            os.killpg(node.pid, signal.SIGKILL)
        node.wait()

    def close(self) -> None:
        for node in (*self.nodes, self.head):
            self.remove(node)

    def _start(self, *options: str, ip: str = "127.0.0.1", within: Sequence[str] = ()) -> subprocess.Popen[bytes]:
        """Start a node, and wait until it is there: two that start at once may take each other's ports.

        Ray gives a node up that is not ready after half a minute, as happens on a busy machine; another is started.
        """
        ray = str(Path(sys.executable).parent / "ray")
        words = [*within, ray, "start", "--block", "--node-ip-address", ip, "--disable-usage-stats", *options]
        words += ["--include-log-monitor", "false"]
        for _ in range(STARTS):
            node, said = self._try([*words, "--dashboard-agent-listen-port", str(free_port())])
            if node.poll() is None:
                return node
            self.remove(node)
        raise AssertionError(said)

    def _try(self, words: Sequence[str]) -> tuple[subprocess.Popen[bytes], str]:
        """Return a node that runs, or has ended, and what it has said."""
        path = self._folder.parent / f"{time.monotonic_ns()}.log"
        with path.open("wb") as log:
            node = subprocess.Popen(words, stdout=log, stderr=log, env=TOKEN, start_new_session=True)
        wait_for(lambda: b"Ray runtime started" in path.read_bytes() or node.poll() is not None)
        return node, path.read_text()

    def _listens(self, port: int) -> bool:
        with contextlib.suppress(OSError):
            socket.create_connection(("127.0.0.1", port), timeout=1).close()
            return True
        return False


def wait_for(what: Callable[[], bool]) -> None:
    """Wait until something is so."""
    deadline = time.monotonic() + START_SECONDS
    while not what():
        assert time.monotonic() < deadline, "a node does not start"
        time.sleep(0.05)
