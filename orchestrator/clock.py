"""The clock, sleeping, waiting and threads, in one place so that simulations in tests can replace them."""

from __future__ import annotations

import queue
import threading
import time as system
from collections.abc import Callable
from typing import Protocol, TypeVar

Item = TypeVar("Item")


class Worker(Protocol):
    """A background thread."""

    def join(self) -> None:
        """Wait until it ends."""


def time() -> float:
    """Return the seconds since 1970, by the wall clock."""
    return system.time()


def monotonic() -> float:
    """Return seconds by a monotonic clock."""
    return system.monotonic()


def since_boot() -> float:
    """Return seconds by a clock that goes on while the machine sleeps, where the system has one."""
    return system.clock_gettime(getattr(system, "CLOCK_BOOTTIME", system.CLOCK_MONOTONIC))


def sleep(seconds: float) -> None:
    """Wait for some seconds."""
    system.sleep(seconds)


def wait(event: threading.Event, seconds: float) -> bool:
    """Wait for an event, and return whether it was set within some seconds."""
    return event.wait(seconds)


def take(items: queue.Queue[Item], seconds: float) -> Item:
    """Return a queue's next item. Raises queue.Empty where none comes within some seconds."""
    return items.get(timeout=seconds)


def in_background(work: Callable[[], None], name: str) -> Worker:
    """Run `work` in a daemon thread."""
    thread = threading.Thread(target=work, name=name, daemon=True)
    thread.start()
    return thread
