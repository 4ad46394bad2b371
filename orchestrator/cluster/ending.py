"""Ends a local Ray beside what follows: it takes over a second, most of which is waiting. Light to import."""

from __future__ import annotations

import gc
import threading
from collections.abc import Callable

_ending: list[threading.Thread] = []


def end(shutdown: Callable[[], object]) -> None:
    """Call `shutdown` in a thread. Whoever may start Ray anew, or hand over to somebody who may, waits first.

    Garbage is collected before, and none until it has ended: Ray ends the whole process, with exit code 1, where one of
    its references is freed while it shuts down.
    """
    wait()
    gc.collect()
    collects = gc.isenabled()
    gc.disable()

    def work() -> None:
        try:
            shutdown()
        finally:
            if collects:
                gc.enable()

    thread = threading.Thread(target=work, name="shutdown")
    _ending.append(thread)
    thread.start()


def wait() -> None:
    """Wait until what is ending has ended."""
    while _ending:
        _ending.pop().join()
