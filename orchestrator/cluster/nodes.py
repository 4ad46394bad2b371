"""The nodes of a cluster: their capacity, their access to the storage, and their processes."""

from __future__ import annotations

import contextlib
import hashlib
import os
import signal
import tempfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import ray
from ray.util.scheduling_strategies import NodeAffinitySchedulingStrategy

from orchestrator.cluster.resources import Resources
from trainables.errors import InputError
from trainables.storage.paths import is_local, storage_path

NODE_PATIENCE = 600.0
"""Seconds to wait for a node that a cell fits on."""


NODE_ANSWER = 120.0
"""Seconds in which a node must start a worker and answer."""


def capacity(resources: Resources, patience: float = 0.0) -> int:
    """Return how many cells the cluster can run at a time now.

    An autoscaling cluster may have no node for a cell yet: one is requested, and waited for up to `patience` seconds.
    Raises InputError where a cell fits on none of its nodes.
    """
    wanted = resources.request()
    if not (fits := _fits(wanted)) and patience:
        amounts = {"num_cpus": wanted.get("CPU", 0), "num_gpus": wanted.get("GPU", 0), "memory": wanted.get("memory")}
        with contextlib.suppress(ray.exceptions.GetTimeoutError):
            options: Any = {name: amount for name, amount in amounts.items() if amount is not None}
            ray.get(ray.remote(**options)(_nothing).remote(), timeout=patience)
        fits = _fits(wanted)
    if not fits:
        alive = [node["Resources"] for node in _nodes() if node["Alive"]]
        most = {name: max((there.get(name, 0.0) for there in alive), default=0.0) for name in wanted}
        asked, given = (", ".join(f"{name} {_amount(name, x)}" for name, x in d.items()) for d in (wanted, most))
        raise InputError(f"a cell fits on no node: it requires {asked}; the most that a node has is {given}")
    return fits


def _fits(wanted: Mapping[str, float]) -> int:
    alive = [node["Resources"] for node in _nodes() if node["Alive"]]
    return sum(
        min((int(there.get(name, 0.0) / amount) for name, amount in wanted.items()), default=1) for there in alive
    )


def _nothing() -> None:
    pass


def _amount(name: str, value: float) -> str:
    return f"{value / 2**30:.1f} GiB" if name == "memory" else f"{value:g}"


def nodes() -> list[tuple[str, str]]:
    """Return (id, host name) of the nodes that are alive."""
    return [(node["NodeID"], node["NodeManagerHostname"]) for node in _nodes() if node["Alive"]]


def _nodes() -> list[dict[str, Any]]:
    nodes: list[dict[str, Any]] = ray.nodes()  # type: ignore[no-untyped-call]
    return nodes


def nodes_without_storage(folder: Path) -> list[str]:
    """Return the host names of nodes that cannot read what is written to `folder` here. Dying nodes are skipped."""
    there = nodes()
    if len(there) < 2 or not is_local(folder):
        return []
    descriptor, name = tempfile.mkstemp(dir=folder, prefix=".probe-")
    os.close(descriptor)
    probe = Path(name)
    try:
        probe.chmod(0o644)  # a node may run under another user
        probe.write_text(token := hashlib.sha256(os.urandom(16)).hexdigest())
        asked = [_on(node, _sees).remote(str(probe), token) for node, _ in there]
        ray.wait(asked, num_returns=len(asked), timeout=NODE_ANSWER)
        return [host for (_, host), answer in zip(there, asked, strict=True) if _answered(answer) is False]
    finally:
        probe.unlink(missing_ok=True)


def _answered(answer: Any) -> bool | None:
    """Return a node's answer, False where it could not read at all; None where it is gone or does not answer."""
    try:
        seen: bool = ray.get(answer, timeout=0)
    except ray.exceptions.RayTaskError:
        return False
    except ray.exceptions.RayError:
        return None
    return seen


def kill(node: str, pid: int) -> None:
    """Send SIGKILL to a process of a node, without waiting for its end."""
    if any(node == there for there, _ in nodes()):
        _on(node, _kill).remote(pid)


def _on(node: str, function: Any) -> Any:
    """Return `function` as a Ray task for one node, which reserves no CPU there."""
    strategy = NodeAffinitySchedulingStrategy(node, soft=False)
    options: Any = {"num_cpus": 0, "max_retries": 0, "scheduling_strategy": strategy}
    return ray.remote(**options)(function)


def _kill(pid: int) -> None:
    os.kill(pid, signal.SIGKILL)


def _sees(path: str, token: str) -> bool:
    probe = storage_path(path)
    return probe.exists() and probe.read_text() == token
