"""Ctrl-C, SIGTERM and the loss of Ray's head: a sweep ends with its cells checkpointed, not in the middle of things."""

from __future__ import annotations

import contextlib
import os
import signal
import threading
import time
from pathlib import Path
from types import FrameType
from typing import Any

from trainables.training.ray_tune import STOP

GRACE_SECONDS = 10.0
"""How long running cells may take to come to their next evaluation and be checkpointed."""


class Interrupt:
    """Takes SIGINT and SIGTERM (which a job's stop sends) while a stage runs; a second one does not wait.

    checkpoints: the folder that the workers look into for the wish to stop.
    """

    def __init__(self, checkpoints: Path | None) -> None:
        self.asked = False
        self._file = checkpoints / STOP if checkpoints else None
        self._before: dict[int, Any] = {}

    def __enter__(self) -> Interrupt:
        if self._file is not None:
            self._file.unlink(missing_ok=True)
        if threading.current_thread() is threading.main_thread():
            for number in (signal.SIGINT, signal.SIGTERM):
                self._before[number] = signal.signal(number, self._signal)
        return self

    def __exit__(self, *error: object) -> None:
        for number, handler in self._before.items():
            signal.signal(number, handler)
        if self._file is not None:
            self._file.unlink(missing_ok=True)

    def _signal(self, number: int, frame: FrameType | None) -> None:
        if self.asked:
            self.now()
            return
        self.asked = True
        threading.Thread(target=self._ask, daemon=True).start()

    def _ask(self) -> None:
        """Tell the workers, and give them some time."""
        if self._file is not None:
            with contextlib.suppress(OSError):
                self._file.write_bytes(b"")
        time.sleep(GRACE_SECONDS)
        self.now()

    def now(self) -> None:
        """Make Tune end the stage without waiting any longer; it listens to SIGUSR1 while a stage runs."""
        if self.asked and self._before and signal.getsignal(signal.SIGUSR1) not in (signal.SIG_DFL, signal.SIG_IGN):
            os.kill(os.getpid(), signal.SIGUSR1)
