"""Ctrl-C, SIGTERM and SIGHUP: a sweep ends with its cells checkpointed, not in the middle of things."""

from __future__ import annotations

import logging
import os
import signal
import threading
from collections.abc import Callable
from pathlib import Path
from types import FrameType
from typing import Any, ClassVar

from trainables.training.worker import STOP

GRACE_SECONDS = 10.0
"""How long running cells may take to come to their next evaluation and be checkpointed."""

SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
"""Ctrl-C; what a job's stop sends; what a terminal or a connection sends that closes."""

log = logging.getLogger("deltatune.interrupt")


class Interrupt:
    """Takes SIGNALS while a stage runs; a second one does not wait. One that is ignored (by nohup, say) stays so.

    now: ends the stage without waiting any longer; called in the main thread. checkpoints: the folder that workers of
    other processes look into for the wish to stop; None: there are none.
    """

    active: ClassVar[Interrupt | None] = None
    """That of the stage that runs in this process."""

    def __init__(self, now: Callable[[], None], checkpoints: Path | None = None) -> None:
        self.asked = False
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
        if self.asked:
            self._now()
            return
        self.asked = True
        threading.Thread(target=self._ask, args=(number,), daemon=True).start()

    def _ask(self, number: int) -> None:
        """Tell the workers, and give them some time; a stage that has ended by then is left alone."""
        log.warning(
            "asked to stop: running cells have %.0f s to be checkpointed; a second time ends now", GRACE_SECONDS
        )
        if self._file is not None:
            try:
                self._file.write_bytes(b"")
            except OSError as error:
                log.warning("cannot ask the workers to stop by %s: %s", self._file, error)
        if not self._over.wait(GRACE_SECONDS):
            os.kill(os.getpid(), number)


def stop_now() -> None:
    """End the stage that runs in this process, if any, without a word to its workers, who may serve another driver."""
    if (stage := Interrupt.active) is not None:
        stage.asked = True
        os.kill(os.getpid(), signal.SIGTERM)
