"""Ray on this machine or on a running cluster: joining it, sending it our code, and reaching its nodes."""

from __future__ import annotations

import contextlib
import hashlib
import math
import os
import shutil
import signal
import socket
import tempfile
import threading
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import ray
from ray.util.scheduling_strategies import NodeAffinitySchedulingStrategy

from orchestrator.provenance import packages_folder, write_staged
from orchestrator.settings import Resources
from trainables.errors import InputError
from trainables.storage import is_local, storage_path

PACKAGES = ("trainables", "search_spaces", "orchestrator", "dashboards")
"""What travels to a cluster, whose nodes need but the dependencies."""

NODE_PATIENCE = 600.0
"""Seconds that a cluster may take to have a node that a cell fits on."""

NODE_ANSWER = 120.0
"""Seconds that a node may take to start a worker and say what it sees."""

HEAD_PATIENCE = 45.0
"""Seconds without an answer after which the head counts as gone. Ray itself ends its processes after 60."""

_QUIET: dict[str, Any] = {"log_to_driver": False, "logging_level": "ERROR"}


@contextmanager
def connected(workers: int | None, address: str | None, resources: Resources) -> Iterator[None]:
    """Ray, started here with CPUs for `workers` cells (default: this process's CPUs), or joined at `address`.

    A Ray that this process has started already is used as it is, and left running.
    Raises InputError where no cluster answers at `address`.
    """
    if ray.is_initialized():
        yield
        return
    if address is None:
        cpus = math.ceil(workers * resources.cpus) if workers else own_cpus()
        ray.init(address="local", num_cpus=cpus, include_dashboard=False, **_QUIET)
    else:
        _join(address)
    try:
        yield
    finally:
        ray.shutdown()


def _join(address: str) -> None:
    check_address(address)
    if "RAY_JOB_CONFIG_JSON_ENV_VAR" in os.environ:  # a job: the cluster has its code already
        os.chdir(tempfile.gettempdir())  # nodes that share a disk unpack the code anew, over this folder
        ray.init(address=address, **_QUIET)
        return
    folder = stage_code(Path(tempfile.mkdtemp(prefix="deltatune-code-")))
    try:
        ray.init(address=address, runtime_env={"working_dir": str(folder)}, **_QUIET)
    except (ConnectionError, RuntimeError, ValueError) as error:
        text = str(error).strip().split("\n")[0]
        raise InputError(f"no Ray cluster could be joined at '{address}': {text}") from None
    finally:
        shutil.rmtree(folder, ignore_errors=True)


def stage_code(folder: Path) -> Path:
    """Copy our packages to `folder`, with what they are a copy of, and nothing that lies beside them."""
    root = packages_folder()
    for package in PACKAGES:
        shutil.copytree(root / package, folder / package, ignore=shutil.ignore_patterns("__pycache__", "*.pyc"))
    write_staged(folder)
    return folder


def check_address(address: str) -> None:
    """Raise InputError where no cluster can be at `address`: Ray itself would try for minutes to reach it."""
    host, port = _host_and_port(address)
    if not host or not port.isdigit():
        if address == "auto":
            return
        raise InputError(f"a cluster's address is HOST:PORT or 'auto' (got '{address}')")
    if error := unreachable(host, int(port)):
        raise InputError(f"no Ray cluster answers at '{address}': {error}")


def _host_and_port(address: str) -> tuple[str, str]:
    """Return both parts of HOST:PORT or [IPV6]:PORT as text, the host without brackets."""
    host, _, port = address.removeprefix("ray://").rpartition(":")
    return host.removeprefix("[").removesuffix("]"), port


def unreachable(host: str, port: int, timeout: float = 5.0) -> str | None:
    """Why nothing answers at an address; None where something does."""
    try:
        socket.create_connection((host, port), timeout=timeout).close()
    except OSError as error:
        return error.strerror or str(error)
    return None


@contextmanager
def watched_head(lost: Callable[[str], None]) -> Iterator[None]:
    """Tell `lost` the address of the cluster's head once it has not answered for HEAD_PATIENCE seconds."""
    address = str(ray.get_runtime_context().gcs_address)
    over = threading.Event()
    watcher = threading.Thread(target=_watch, args=(address, lost, over), daemon=True)
    watcher.start()
    try:
        yield
    finally:
        over.set()


def _watch(address: str, lost: Callable[[str], None], over: threading.Event) -> None:
    host, port = _host_and_port(address)
    heard = time.monotonic()
    while not over.wait(HEAD_PATIENCE / 9):
        if not unreachable(host, int(port)):
            heard = time.monotonic()
        elif time.monotonic() - heard > HEAD_PATIENCE and not over.is_set():
            lost(address)
            return


def capacity(resources: Resources, patience: float = 0.0) -> int:
    """How many cells the cluster takes at a time now.

    A cluster that grows may have no node for a cell yet: one is asked for and waited for, `patience` seconds at most.
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
        raise InputError(f"a cell fits on no node: it asks for {asked}; the most that a node has is {given}")
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
    """(id, host name) of the nodes that are alive."""
    return [(node["NodeID"], node["NodeManagerHostname"]) for node in _nodes() if node["Alive"]]


def _nodes() -> list[dict[str, Any]]:
    nodes: list[dict[str, Any]] = ray.nodes()  # type: ignore[no-untyped-call]
    return nodes


def blind_nodes(folder: Path) -> list[str]:
    """Host names of the nodes that do not see what is written to `folder` here; those that are dying say nothing."""
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
    """What a node has said, False where it could not read at all; None where it is gone, or does not answer."""
    try:
        seen: bool = ray.get(answer, timeout=0)
    except ray.exceptions.RayTaskError:
        return False
    except ray.exceptions.RayError:
        return None
    return seen


def kill(node: str, pid: int) -> None:
    """Kill a process of a node, whatever it hangs in. Does not wait for it."""
    if any(node == there for there, _ in nodes()):
        _on(node, _kill).remote(pid)


def _on(node: str, function: Any) -> Any:
    """`function` as a task for one node, which takes no CPU there."""
    strategy = NodeAffinitySchedulingStrategy(node, soft=False)
    options: Any = {"num_cpus": 0, "max_retries": 0, "scheduling_strategy": strategy}
    return ray.remote(**options)(function)


def _kill(pid: int) -> None:
    os.kill(pid, signal.SIGKILL)


def _sees(path: str, token: str) -> bool:
    probe = storage_path(path)
    return probe.exists() and probe.read_text() == token


def own_cpus() -> int:
    """The CPUs that this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1
