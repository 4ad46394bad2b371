"""The executor that runs cells in worker processes, without Ray. The cell of a lost process is tried again."""

from __future__ import annotations

import itertools
import signal
import subprocess
from collections.abc import Iterator
from contextlib import ExitStack
from dataclasses import dataclass, field, replace
from multiprocessing.connection import wait
from pathlib import Path
from typing import Any

from rich.console import Console

from orchestrator.child_process import ChildProcess
from orchestrator.cluster.resources import local_cpus
from orchestrator.execution.executors.executor import StageRun, Workplace
from orchestrator.execution.executors.monitor import StageMonitor
from orchestrator.execution.interrupt import Interrupt
from orchestrator.execution.settings import Settings
from orchestrator.execution.work_queue import Pack
from trainables.storage.folders import make_folder
from trainables.training.messages import Reached, Started, WorkerPayload
from trainables.training.worker_process import Completed, Crashed, Task

_MAIN = "from trainables.training.worker_process import main; main()"

TICK_SECONDS = 0.2
"""Seconds between two checks of time limits and interrupts."""


class ProcessPoolExecutor:
    """Runs as many packs at a time as there are workers, each in a separate process."""

    def __init__(self, settings: Settings) -> None:
        self._processes: list[_Process] = []
        self._workers = settings.workers or local_cpus()
        self._checkpoints: Path | None = None

    def open(self, checkpoints: Path, console: Console, stack: ExitStack) -> Workplace:
        """Return the workplace. Processes start when there is a pack for them, and stay until the sweep ends."""
        stack.callback(self._close)
        self._checkpoints = make_folder(checkpoints)
        return Workplace(self._workers, self._workers, self._checkpoints)

    def run(self, stages: Iterator[StageRun]) -> None:
        """Run the packs of each stage's queue."""
        for stage in stages:
            self._run(stage)

    def _run(self, run: StageRun) -> None:
        stage = _Stage(run.monitor, run.payload, self._processes, self._workers)
        try:
            with Interrupt(stage.end_now, self._checkpoints) as interrupt:
                stage.run(interrupt)
        except BaseException:
            self._close()
            raise

    def _close(self) -> None:
        """End all processes at once."""
        while self._processes:
            self._processes.pop().end()


@dataclass
class _Process(ChildProcess):
    """A worker process and its present work."""

    trial: str | None = None
    """None: it is idle."""
    payload: WorkerPayload | None = None
    """The payload of its last stage."""
    sent: set[str] = field(default_factory=set)
    """The keys of the sources of that stage that it has."""
    last_words: str = ""
    """Why it ends, if it has said so."""


class _Stage:
    def __init__(self, monitor: StageMonitor, payload: WorkerPayload, processes: list[_Process], workers: int) -> None:
        self._monitor, self._payload = monitor, payload
        self._processes, self._workers = processes, workers
        self._numbers = itertools.count()
        self._ended_now = False

    def run(self, interrupt: Interrupt) -> None:
        """Hand out packs and process reports until nothing is left or an interrupt ends the stage."""
        while not self._ended_now:
            self._monitor.queue.stopping |= interrupt.requested
            while self._hand_out():
                pass
            busy = [process for process in self._processes if process.trial is not None]
            if not busy:
                return
            ready: list[Any] = wait([process.connection for process in busy], timeout=TICK_SECONDS)
            for process in busy:
                if process.connection in ready:
                    self._take_in(process)
            self._end_overdue()

    def end_now(self) -> None:
        """End the stage at the next check, whatever runs."""
        self._ended_now = True

    def _hand_out(self) -> bool:
        """Give an idle or a new worker its next pack; return False where there is no worker or no pack."""
        idle = next((process for process in self._processes if process.trial is None), None)
        if idle is None and len(self._processes) >= self._workers:
            return False
        trial = str(next(self._numbers))
        if (pack := self._monitor.next(trial)) is None:
            return False
        process = idle or self._start()
        process.trial = trial
        self._send(process, pack)
        return True

    def _start(self) -> _Process:
        process = _Process.start(_MAIN)
        self._processes.append(process)
        return process

    def _send(self, process: _Process, pack: Pack) -> None:
        if process.payload is not self._payload:
            process.payload, process.sent = self._payload, set()
            self._write(process, replace(self._payload, sources={}))
        keys = {cell.source_key for cell in pack.cells if cell.sources} - process.sent
        process.sent |= keys
        sources = {key: self._payload.sources[key] for key in keys}
        self._write(process, Task([cell.to_json() for cell in pack.cells], pack.together, sources))

    def _write(self, process: _Process, message: object) -> None:
        try:
            process.connection.send(message)
        except OSError:
            return  # the process is gone; reading from it will report that

    def _take_in(self, process: _Process) -> None:
        """Process one message of a busy process, or its end."""
        assert process.trial is not None
        try:
            message = process.connection.recv()
        except (EOFError, OSError):
            self._lost(process, process.trial)
            return
        if isinstance(message, Crashed):
            process.last_words = message.why
        elif isinstance(message, Completed):
            trial, process.trial = process.trial, None
            self._monitor.on_completed(trial)
        else:
            self._monitor.on_report(process.trial, message)
            if isinstance(message, Started):
                self._write(process, True)
            elif isinstance(message, Reached):
                self._write(process, self._monitor.stops(process.trial, message.evaluations, message.score))

    def _lost(self, process: _Process, trial: str) -> None:
        self._processes.remove(process)
        try:
            code: int | None = process.process.wait(timeout=1.0)
        except subprocess.TimeoutExpired:
            code = None
        process.end()
        self._monitor.on_lost(trial, process.last_words or _cause(code))

    def _end_overdue(self) -> None:
        for running in self._monitor.overdue():
            for process in self._processes:
                if process.process.pid == running.pid:
                    process.process.kill()


def _cause(code: int | None) -> str:
    """Return why a process has ended, as text."""
    if code is None:
        return "its process no longer answers"
    if code >= 0:
        return f"its process has ended with exit code {code}"
    name = signal.Signals(-code).name
    return f"its process was ended by {name}" + (" (out of memory?)" if name == "SIGKILL" else "")
