"""Ctrl-C, SIGTERM and SIGHUP: running cells are checkpointed before the sweep ends."""

from __future__ import annotations

import logging
import os
import signal
import threading
from collections.abc import Callable
from pathlib import Path
from types import FrameType
from typing import Any, ClassVar

from trainables.training.messages import STOP

GRACE_SECONDS = 10.0
"""Seconds for running cells to reach their next evaluation and be checkpointed."""

SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
"""Ctrl-C; the stop of a job; the closing of a terminal or connection."""

log = logging.getLogger("deltatune.interrupt")


class Interrupt:
    """Handles SIGNALS while a stage runs; the second one ends it at once. Ignored signals (nohup) stay ignored.

    now: ends the stage at once; called in the main thread. checkpoints: the folder in which workers in other processes
    look for the request to stop; None: there are none.
    """

    active: ClassVar[Interrupt | None] = None
    """The instance of the stage that runs in this process, if any."""

    def __init__(self, now: Callable[[], None], checkpoints: Path | None = None) -> None:
        self.requested = False
        self._now = now
        self._file = checkpoints / STOP if checkpoints else None
        self._over = threading.Event()
        self._before: dict[int, Any] = {}

    def __enter__(self) -> Interrupt:
        if self._file is not None:
            self._file.unlink(missing_ok=True)
        if threading.current_thread() is threading.main_thread():
            for number in (number for number in SIGNALS if signal.getsignal(number) != signal.SIG_IGN):
                self._before[number] = signal.signal(number, self._signal)
        Interrupt.active = self
        return self

    def __exit__(self, *error: object) -> None:
        Interrupt.active = None
        self._over.set()
        for number, handler in self._before.items():
            signal.signal(number, handler)
        if self._file is not None:
            self._file.unlink(missing_ok=True)

    def _signal(self, number: int, frame: FrameType | None) -> None:
        if self.requested:
            self._now()
            return
        self.requested = True
        threading.Thread(target=self._ask, args=(number,), daemon=True).start()

    def _ask(self, number: int) -> None:
        """Ask the workers to stop, and end the stage after GRACE_SECONDS if it still runs."""
        log.warning("stopping: running cells have %.0f s to be checkpointed; a second signal ends them", GRACE_SECONDS)
        if self._file is not None:
            try:
                self._file.write_bytes(b"")
            except OSError as error:
                log.warning("cannot ask the workers to stop by %s: %s", self._file, error)
        if not self._over.wait(GRACE_SECONDS):
            os.kill(os.getpid(), number)


def stop_now() -> None:
    """End the stage that runs in this process, if any, without asking its workers, which may serve another driver."""
    if (stage := Interrupt.active) is not None:
        stage.requested = True
        os.kill(os.getpid(), signal.SIGTERM)
