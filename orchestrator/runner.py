"""One stage's cells through one `tune.Tuner`: on this machine, or on a Ray cluster that is running already."""

from __future__ import annotations

import math
import os
import shutil
import signal
import socket
import tempfile
import threading
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import ray
from ray import tune

from orchestrator.ledger import Ledger
from orchestrator.progress import Display
from orchestrator.search import Proposals, Tuned
from trainables.agents import agent_named
from trainables.cell import Cell
from trainables.errors import InputError
from trainables.trainable import run_cells

Outcome = dict[str, Any]
"""What `trainables.trainable.outcome` returns."""

PACK = 8
"""Most cells of one trial, for cells that take less than about a second."""

RETRIES = 2
"""How often a trial whose worker or node was lost is started again."""


@contextmanager
def connected(workers: int | None, address: str | None) -> Iterator[int]:
    """Ray, started here with `workers` CPUs (default: this process's), or joined at `address`; yields the CPUs.

    A Ray that this process has started already is used as it is, and left running.
    Raises InputError where no cluster answers at `address`.
    """
    if ray.is_initialized():
        yield min(workers or int(_cpus()), int(_cpus()))
        return
    quiet: dict[str, Any] = {"log_to_driver": False, "logging_level": "ERROR"}
    if address is None:
        ray.init(address="local", num_cpus=workers or _own_cpus(), include_dashboard=False, **quiet)
    else:
        check_address(address)
        try:
            ray.init(address=address, runtime_env={"working_dir": str(_code()), "excludes": _EXCLUDES}, **quiet)
        except (ConnectionError, RuntimeError, ValueError) as error:
            text = str(error).strip().split("\n")[0]
            raise InputError(f"no Ray cluster could be joined at '{address}': {text}") from None
    try:
        cpus = max(1, int(_cpus()))
        yield min(workers or cpus, cpus)
    finally:
        ray.shutdown()


def _own_cpus() -> int:
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def check_address(address: str) -> None:
    """Raise InputError where no cluster can be at `address`: Ray itself would try for minutes to reach it."""
    host, _, port = address.removeprefix("ray://").rpartition(":")
    if not host or not port.isdigit():
        if address == "auto":
            return
        raise InputError(f"a cluster's address is HOST:PORT or 'auto' (got '{address}')")
    try:
        socket.create_connection((host, int(port)), timeout=5).close()
    except OSError as error:
        raise InputError(f"no Ray cluster answers at '{address}': {error.strerror or error}") from None


def _cpus() -> float:
    resources: dict[str, float] = ray.cluster_resources()  # type: ignore[no-untyped-call]
    return resources.get("CPU", 1.0)


_EXCLUDES = ["/results/", "/tests/", "/docs/", "/.venv/", "/.git/", "*.db"]


def _code() -> Path:
    """The folder that holds the import packages: what a worker needs."""
    return Path(__file__).resolve().parent.parent


class Relay(tune.Callback):
    """Hands each ended cell to the driver as it is reported, and counts what is running."""

    def __init__(self, ended: Callable[[Outcome], None], display: Display | None) -> None:
        self._ended, self._display = ended, display
        self.errors: list[str] = []

    def __getstate__(self) -> dict[str, Any]:
        """Nothing to save: a sweep resumes from its records, never from Tune's."""
        return {"_ended": None, "_display": None, "errors": []}

    def on_trial_result(
        self, iteration: int, trials: list[Any], trial: Any, result: dict[str, Any], **info: Any
    ) -> None:
        """Take over the outcomes of a report, and free Tune of their weight."""
        if self._display and "progress" in result:
            self._display.progress(**result["progress"])
        outcomes = result.get("ended") or []
        while outcomes:
            self._ended(outcomes.pop(0))

    def on_trial_error(self, iteration: int, trials: list[Any], trial: Any, **info: Any) -> None:
        """Note a trial whose worker was lost more often than it is started again."""
        lines = str(trial.get_error() or "its worker was lost").strip().splitlines()
        self.errors.append(lines[-1] if lines else "its worker was lost")

    def on_step_end(self, iteration: int, trials: list[Any], **info: Any) -> None:
        """Count the running trials; each runs one cell at a time."""
        if self._display:
            self._display.running(sum(trial.status == "RUNNING" for trial in trials))


def packs(cells: Sequence[Cell], workers: int) -> list[list[Cell]]:
    """The cells in trials: small ones several to a trial, but so that every worker gets four turns at least."""
    size = max(1, min(PACK, math.ceil(len(cells) / (4 * workers))))
    small = sorted((cell for cell in cells if agent_named(cell.agent).kind == "tabular"), key=lambda cell: cell.task)
    large = [[cell] for cell in cells if agent_named(cell.agent).kind != "tabular"]
    return large + [small[start : start + size] for start in range(0, len(small), size)]


@dataclass(frozen=True)
class Work:
    """What a stage has to run."""

    cells: Sequence[Cell]
    tuned: Sequence[Tuned]
    """Searches, which ask for more cells."""
    sources: Mapping[str, Mapping[str, Any]]
    """The arrays of each source, by `Cell.source_key`."""
    keep: bool
    """Whether what each cell has learned is wanted."""
    checkpoints: Path
    """The folder for the states of long cells; a worker that does not see it works without."""
    checkpoint_seconds: float
    """Time between the checkpoints of a cell."""


def run_stage(
    work: Work, workers: int, ended: Callable[[Outcome], None], display: Display, ledger: Ledger
) -> list[str]:
    """Run a stage, handing each outcome to `ended`; the errors of trials whose worker was lost for good."""
    relay = Relay(ended, display)
    folder = tempfile.mkdtemp(prefix="deltatune-")
    trainable = tune.with_parameters(
        run_cells,
        sources=dict(work.sources),
        keep=work.keep,
        checkpoints=str(work.checkpoints),
        checkpoint_seconds=work.checkpoint_seconds,
    )
    tuner = tune.Tuner(
        tune.with_resources(trainable, {"cpu": 1}),
        tune_config=tune.TuneConfig(
            search_alg=Proposals(packs(work.cells, workers), work.tuned, ledger.ended, ledger.score, at_once=workers),
            num_samples=-1,
            reuse_actors=True,
            trial_dirname_creator=lambda trial: str(trial.trial_id),
        ),
        run_config=tune.RunConfig(
            storage_path=folder,
            name="stage",
            verbose=0,
            callbacks=[relay],
            failure_config=tune.FailureConfig(max_failures=RETRIES),
        ),
    )
    try:
        with _terminate_as_interrupt():
            tuner.fit()
    finally:
        shutil.rmtree(folder, ignore_errors=True)
    return relay.errors


@contextmanager
def _terminate_as_interrupt() -> Iterator[None]:
    """SIGTERM, which `ray job stop` sends, ends a sweep as gracefully as Ctrl-C does."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = signal.signal(signal.SIGTERM, lambda *_: os.kill(os.getpid(), signal.SIGINT))
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, before)
