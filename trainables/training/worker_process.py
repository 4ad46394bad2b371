"""The worker process of `deltatune sweep --local`, which receives packs and sends reports over a socket."""

from __future__ import annotations

import contextlib
import os
import signal
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from multiprocessing.connection import Connection
from typing import Any

from trainables.cell import Cell
from trainables.collector import collect_seldom
from trainables.learners.learner import prepare
from trainables.numerics.threads import one_thread
from trainables.plugins import loader
from trainables.storage.paths import storage_path
from trainables.training.messages import Reached, Report, Started, WorkerPayload
from trainables.training.worker import StopFile, forwarded_log, run_pack


@dataclass(frozen=True)
class Task:
    """A pack for a worker process."""

    cells: Sequence[dict[str, Any]]
    """The cells, as `Cell.to_json` returns them."""
    together: bool
    sources: Mapping[str, Mapping[str, Any]]
    """The sources of the stage that this pack needs, and that were not sent before."""


@dataclass(frozen=True)
class Crashed:
    """The process ends because of an error outside its cells."""

    why: str


@dataclass(frozen=True)
class Completed:
    """The process has finished its pack, and waits for the next one."""


class PackStoppedError(Exception):
    """Early stopping has ended a pack."""


def main() -> None:
    """Run the packs that arrive on the socket, whose descriptor is the first argument, until it closes."""
    collect_seldom()
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the driver handles Ctrl-C, and passes it on by the stop file
    connection = Connection(int(sys.argv[1]))
    try:
        _serve(connection)
    except (EOFError, BrokenPipeError, ConnectionResetError):
        return  # the driver has ended, or is gone
    except Exception as error:
        with contextlib.suppress(OSError):
            connection.send(Crashed(loader.describe_error(error)))


def _serve(connection: Connection) -> None:
    """Run one pack after the other, each with the payload of its stage, which arrives before the first pack."""
    one_thread()
    driver = os.getppid()
    payload, sources = None, {}

    def tell(report: Report) -> None:
        connection.send(report)
        if isinstance(report, Reached) and connection.recv():
            raise PackStoppedError

    def stop() -> bool:
        return stop_file() or os.getppid() != driver

    while True:
        message: WorkerPayload | Task = connection.recv()
        if isinstance(message, WorkerPayload):
            payload, sources = message, dict(message.sources)
            loader.install(payload.plugins)
            continue
        assert payload is not None
        sources.update(message.sources)
        stop_file = StopFile(storage_path(payload.checkpoints) if payload.checkpoints else None)
        prepare({data["agent"] for data in message.cells})
        connection.send(Started(os.getpid(), "local"))
        connection.recv()  # from here on the driver handles errors
        try:
            with forwarded_log(tell) as send:
                cells = [Cell.from_json(data) for data in message.cells]
                run_pack(cells, message.together, replace(payload, sources=sources), send, stop)
        except PackStoppedError:
            pass
        connection.send(Completed())
