"""The connection to Ray, on this machine or on a cluster: joining it and sending it this code."""

from __future__ import annotations

import math
import os
import shutil
import socket
import tempfile
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import ray

from orchestrator.cluster import ending
from orchestrator.cluster.resources import Resources, local_cpus
from orchestrator.errors import SweepError
from orchestrator.results.provenance import packages_folder, write_staged
from trainables.errors import InputError

PACKAGES = ("trainables", "search_spaces", "orchestrator", "dashboards", "deltatune")
"""The packages that are shipped to a cluster; its nodes only need the dependencies."""


HEAD_PATIENCE = 45.0
"""Seconds without an answer after which the head counts as gone. Ray itself ends its processes after 60."""

_QUIET: dict[str, Any] = {"log_to_driver": False, "logging_level": "ERROR"}


@contextmanager
def connected(workers: int | None, address: str | None, resources: Resources) -> Iterator[None]:
    """Start Ray with CPUs for `workers` cells (default: this process's CPUs), or join it at `address`; close it after.

    A Ray instance that this process has started before is used as it is, and left running.
    Raises InputError where no cluster answers at `address`.
    """
    ending.wait()
    if ray.is_initialized():
        yield
        return
    if address is None:
        cpus = math.ceil(workers * resources.cpus) if workers else local_cpus()
        _start(cpus)
    else:
        _join(address)
    try:
        yield
    except BaseException:
        ray.shutdown()  # at once: the error's frames hold references of Ray, which nobody may free meanwhile
        raise
    ending.end(ray.shutdown)


def _start(cpus: int) -> None:
    """Start Ray on this machine. Raises SweepError where it does not start, as on a machine that is too busy."""
    try:
        ray.init(address="local", num_cpus=cpus, include_dashboard=False, **_QUIET)
    except Exception as error:  # Ray raises a plain Exception where a node is not ready in time
        why = " ".join(str(error).split(".")[0].split())
        raise SweepError(
            f"Ray did not start on this machine ({why}): the same command tries again, and --local needs no Ray"
        ) from error


def _join(address: str) -> None:
    check_address(address)
    if "RAY_JOB_CONFIG_JSON_ENV_VAR" in os.environ:  # a job: the cluster has its code already
        os.chdir(tempfile.gettempdir())  # nodes that share a disk unpack the code again, over this folder
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
    """Copy the packages, and nothing else, to `folder`, with a file on their version and commit."""
    root = packages_folder()
    for package in PACKAGES:
        shutil.copytree(root / package, folder / package, ignore=shutil.ignore_patterns("__pycache__", "*.pyc"))
    write_staged(folder)
    return folder


def check_address(address: str) -> None:
    """Raise InputError where no cluster can be at `address`; Ray would try for minutes to reach it."""
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
    """Return why nothing answers at an address, or None."""
    try:
        socket.create_connection((host, port), timeout=timeout).close()
    except OSError as error:
        return error.strerror or str(error)
    return None


@contextmanager
def watched_head(lost: Callable[[str], None]) -> Iterator[None]:
    """Call `lost` with the address of the cluster's head once it has not answered for HEAD_PATIENCE seconds."""
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
