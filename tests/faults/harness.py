"""What the fault tests share: sweeps as a user runs them, and ways to do harm to them."""

from __future__ import annotations

import contextlib
import copy
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any

import pandas as pd
import pytest
import yaml
from conftest import LOCAL, SPACE, timeless
from rich.console import Console

from orchestrator.execution.settings import RunSummary, Settings
from orchestrator.execution.sweep import run
from orchestrator.execution.work_queue import Pack, WorkQueue
from orchestrator.results.sweep_folder import Results
from search_spaces.loading import parse
from tests.small_figures import DRAWN_SMALL

PATIENCE = 240.0
"""Seconds that a test waits for something to happen on a busy machine."""


def space(**changes: Any) -> dict[str, Any]:
    return copy.deepcopy(SPACE) | changes


def sweep(storage: Path, settings: Settings = LOCAL, **changes: Any) -> tuple[Results, RunSummary]:
    """A sweep in this process, without Ray unless the settings say so."""
    results = Results.create(storage, "small", parse("small", space(**changes)))
    return results, run(results, settings, Console(quiet=True))


def points(storage: Path) -> pd.DataFrame:
    """The curves of a sweep, all bits of them."""
    return timeless(Results.open(storage, "small").write_tables()[1])


def assert_same(storage: Path, undisturbed: Path) -> None:
    """Nothing lost, nothing double, every bit the same."""
    pd.testing.assert_frame_equal(points(storage), points(undisturbed), check_exact=True)
    cells = Results.open(storage, "small").write_tables()[0]
    assert cells["cell_id"].is_unique
    assert set(cells["status"]) == {"done"}


def on_start(monkeypatch: pytest.MonkeyPatch, harm: Callable[[Pack, int], None]) -> None:
    """Do harm to workers at the moment that they begin with a pack: `harm` is told the pack and the process."""
    started = WorkQueue.on_started

    def harmed(queue: WorkQueue, trial: str, pid: int, node: str) -> None:
        started(queue, trial, pid, node)
        harm(queue.running[trial].pack, pid)

    monkeypatch.setattr(WorkQueue, "on_started", harmed)


@contextlib.contextmanager
def driver(
    folder: Path,
    *words: str,
    python: tuple[str, ...] = DRAWN_SMALL,
    env: Mapping[str, str] | None = None,
    **changes: Any,
) -> Iterator[subprocess.Popen[str]]:
    """`deltatune sweep` in a process of its own, with its storage in `folder`."""
    path = folder / "space.yaml"
    path.write_text(yaml.safe_dump(space(**changes), sort_keys=False))
    command = [sys.executable, *python, "sweep", str(path), "--storage", str(folder), *words]
    process = subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, start_new_session=True, env=env
    )
    try:
        yield process
    finally:
        with contextlib.suppress(ProcessLookupError):
            os.killpg(process.pid, signal.SIGKILL)
        process.communicate()


def wait_for(what: Callable[[], bool], process: subprocess.Popen[str] | None = None) -> None:
    """Wait until something is so; a driver that ends before that is a failure."""
    deadline = time.monotonic() + PATIENCE
    while not what():
        assert process is None or process.poll() is None, f"the sweep ended: {_said(process)}"
        assert time.monotonic() < deadline, "it did not happen"
        time.sleep(0.05)


def _said(process: subprocess.Popen[str]) -> str:
    out, err = process.communicate()
    return f"{process.returncode} {out} {err}"


def ended(storage: Path, cells: int) -> Callable[[], bool]:
    """Whether at least so many cells have ended."""
    folder = storage / "small"
    return lambda: (folder / "sweep.json").exists() and len(Results(folder).heads()) >= cells
