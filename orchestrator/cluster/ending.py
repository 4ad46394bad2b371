"""Ends a local Ray beside what follows: it takes over a second, most of which is waiting. Light to import."""

from __future__ import annotations

import threading
from collections.abc import Callable

_ending: list[threading.Thread] = []


def end(shutdown: Callable[[], object]) -> None:
    """Call `shutdown` in a thread. Whoever may start Ray anew, or hand over to somebody who may, waits first."""
    wait()
    thread = threading.Thread(target=shutdown, name="shutdown")
    _ending.append(thread)
    thread.start()


def wait() -> None:
    """Wait until what is ending has ended."""
    while _ending:
        _ending.pop().join()
