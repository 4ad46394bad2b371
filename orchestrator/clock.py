"""What time it is, and whatever waits for a time: the simulated driver of the tests has a clock of its own."""

from __future__ import annotations

import queue
import threading
import time as system
from collections.abc import Callable
from typing import Protocol, TypeVar

Item = TypeVar("Item")


class Worker(Protocol):
    """Something that runs beside."""

    def join(self) -> None:
        """Wait until it has ended."""


def time() -> float:
    """Return the seconds since 1970, by a clock that may be set."""
    return system.time()


def monotonic() -> float:
    """Return seconds by a clock that only ever goes on."""
    return system.monotonic()


def sleep(seconds: float) -> None:
    """Do nothing for a while."""
    system.sleep(seconds)


def wait(event: threading.Event, seconds: float) -> bool:
    """Return whether an event comes within some seconds."""
    return event.wait(seconds)


def take(items: queue.Queue[Item], seconds: float) -> Item:
    """Return the next of a queue's items; queue.Empty where none comes within some seconds."""
    return items.get(timeout=seconds)


def beside(work: Callable[[], None], name: str) -> Worker:
    """Run `work` in a thread of its own, which ends with the process."""
    thread = threading.Thread(target=work, name=name, daemon=True)
    thread.start()
    return thread
