"""Sweeps on a cluster whose workers and nodes are killed at random, held against one that nobody disturbed."""

from __future__ import annotations

import contextlib
import os
import random
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

import pandas as pd
import yaml

from orchestrator.results.sweep_folder import Results
from tests.faults.ray_cluster import TOKEN, Cluster

MEAN_SECONDS = 20.0
"""Between two kills, on average."""

NODE_SHARE = 0.3
"""Of the kills that take a whole node; the others take one worker's process."""

MAX_ABSENCE = 10.0
"""Seconds until a node that was switched off is replaced, at most."""

ROUND_SECONDS = 900.0
"""After which a sweep is taken for stuck."""

SPACE = {
    "schema": 1,
    "name": "killed",
    "family": "tests",
    "seeds": 16,
    "scenarios": [{"source": {"task": "windy_gridworld"}, "targets": ["windy_gridworld:wind=small"]}],
    "hyperparameters": {"episodes": [100], "evaluate_every": [10]},
    "agents": {"q_learning": {}, f"{Path(__file__).with_name('patient.py')}:Agent": {}},
}
"""16 cells of the source stage, and 32 of the transfer stage, of which half wait for some seconds."""


@dataclass
class Killed:
    """What was done, and what came of it."""

    rounds: int = 0
    workers: int = 0
    nodes: int = 0
    calm_seconds: float = 0.0
    """Of the sweep that nobody disturbed."""
    seconds: float = 0.0
    """Of the others."""
    commands: int = 0
    """Commands that were given once more, mostly after a cell had lost its worker too often."""
    wrong: list[str] = field(default_factory=list)

    def __str__(self) -> str:
        kills = self.workers + self.nodes
        lost = self.seconds - self.rounds * self.calm_seconds
        each = f", {lost / kills:.1f} s for each kill" if kills else ""
        return (
            f"{self.rounds} sweeps in {self.seconds / 60:.1f} minutes; "
            f"{self.workers} workers and {self.nodes} nodes killed; commands given again: {self.commands}; "
            f"{len(self.wrong)} with another bit {self.wrong}; "
            f"undisturbed {self.calm_seconds:.0f} s a sweep, so {lost:.0f} s were lost{each}"
        )


def kill(minutes: float, seed: int, say: bool = False) -> Killed:
    """Run sweep after sweep for some minutes on a head and two nodes of one CPU each, while a seed decides who dies."""
    found, rng = Killed(), random.Random(seed)
    with tempfile.TemporaryDirectory(prefix="dt-", dir="/tmp", ignore_cleanup_errors=True) as folder, _only_its_own():
        cluster = Cluster(Path(folder) / "ray", nodes=2)
        try:
            want, found.calm_seconds = _sweep(cluster, Path(folder) / "calm", None, found)
            deadline = time.monotonic() + 60 * minutes
            while time.monotonic() < deadline:
                there, seconds = _sweep(cluster, Path(folder) / f"round{found.rounds}", rng, found)
                found.rounds, found.seconds = found.rounds + 1, found.seconds + seconds
                if there != want:
                    found.wrong.append(f"sweep {found.rounds}")
                if say:
                    print(found, flush=True)
        finally:
            cluster.close()
    return found


def _sweep(cluster: Cluster, storage: Path, rng: random.Random | None, found: Killed) -> tuple[list[str], float]:
    """Return (the curves of one sweep to the last bit, the seconds that it took)."""
    storage.mkdir()
    file = storage / "space.yaml"
    file.write_text(yaml.safe_dump(SPACE, sort_keys=False))
    words = ["sweep", str(file), "--storage", str(storage), "--address", cluster.address, "--no-mlflow"]
    command = [sys.executable, "-m", "deltatune", *words]
    began = time.monotonic()
    for attempt in range(5):
        found.commands += attempt > 0
        with (storage / "said").open("ab") as said:
            driver = subprocess.Popen(
                [*command, *(["--retry-failed"] if attempt else [])], stdout=said, stderr=said, env=TOKEN
            )
            _harm(cluster, driver, rng, found)
        results = Results.open(storage, "killed")
        if driver.returncode == 0 and {head.status for head in results.heads().values()} == {"done"}:
            break
    else:
        raise AssertionError((storage / "said").read_text())
    seconds = time.monotonic() - began
    cells, points = results.write_tables()
    assert cells["cell_id"].is_unique
    assert set(cells["status"]) == {"done"}
    return _bits(cells) + _bits(points), seconds


def _bits(table: pd.DataFrame) -> list[str]:
    timeless = table.drop(columns=["seconds", "steps_per_second"], errors="ignore")
    return [repr(row) for row in timeless.to_numpy().tolist()]


def _harm(cluster: Cluster, driver: subprocess.Popen[bytes], rng: random.Random | None, found: Killed) -> None:
    """Wait for a driver to end, and kill meanwhile."""
    until = time.monotonic() + ROUND_SECONDS
    while driver.poll() is None:
        pause = rng.expovariate(1 / MEAN_SECONDS) if rng else 1.0
        with contextlib.suppress(subprocess.TimeoutExpired):
            driver.wait(pause)
            return
        if time.monotonic() > until:
            driver.kill()
            raise AssertionError("a sweep does not end")
        if rng is None:
            continue
        assert all(node.poll() is None for node in cluster.nodes), "a node has ended that nobody killed"
        if rng.random() < NODE_SHARE:
            cluster.remove(cluster.nodes.pop(rng.randrange(len(cluster.nodes))))
            found.nodes += 1
            time.sleep(rng.uniform(0, MAX_ABSENCE))
            cluster.nodes.append(cluster.add_node())
        elif workers := [pid for node in cluster.nodes for pid in _workers(node.pid)]:
            with contextlib.suppress(ProcessLookupError):
                os.kill(rng.choice(sorted(workers)), signal.SIGKILL)
            found.workers += 1


def _workers(node: int) -> list[int]:
    """Return the processes of Ray's workers below a node's; without its agents a node would be gone."""
    commands = {pid: _command(pid) for pid in _below(node)}
    return [pid for pid, name in commands.items() if name.startswith("ray::") and "Agent" not in name]


def _below(root: int) -> list[int]:
    """Return a process's descendants."""
    children: dict[int, list[int]] = {}
    for path in Path("/proc").glob("[0-9]*/stat"):
        with contextlib.suppress(OSError, IndexError, ValueError):
            parent = int(path.read_text().rsplit(")", 1)[1].split()[1])
            children.setdefault(parent, []).append(int(path.parent.name))
    found, at = [], [root]
    while at:
        found += (more := children.get(at.pop(), []))
        at += more
    return found


def _command(pid: int) -> str:
    with contextlib.suppress(OSError):
        return Path(f"/proc/{pid}/cmdline").read_bytes().replace(b"\0", b" ").decode(errors="replace")
    return ""


@contextlib.contextmanager
def _only_its_own() -> Iterator[None]:
    """End what this process has started and its children have left, and nothing else."""
    import ctypes

    ctypes.CDLL(None).prctl(36, 1, 0, 0, 0)  # PR_SET_CHILD_SUBREAPER: orphans become this process's children
    before = set(_below(os.getpid()))
    try:
        yield
    finally:
        for pid in set(_below(os.getpid())) - before:
            with contextlib.suppress(ProcessLookupError):
                os.kill(pid, signal.SIGKILL)
        with contextlib.suppress(ChildProcessError):
            while os.waitpid(-1, os.WNOHANG)[0]:
                pass
        ctypes.CDLL(None).prctl(36, 0, 0, 0, 0)
