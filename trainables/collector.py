"""Python's garbage collector, in processes that this project starts: it rarely has anything to do in them.

Most objects are those of imported modules, which stay, and by default it looks through all of them again and again:
a third of the time that Ray, MLflow and matplotlib take to be imported, and as long once more when a process ends.
"""

from __future__ import annotations

import atexit
import functools
import gc

THRESHOLDS = 50_000, 10, 10
"""Objects made since the last collection, and collections of younger objects, after which one is due."""


@functools.cache  # a worker of Ray calls it with each of its trials, and an exit function is registered anew each time
def collect_seldom() -> None:
    """Collect garbage more seldom in this process, and not when it ends, where memory is freed anyway."""
    gc.set_threshold(*THRESHOLDS)
    atexit.register(gc.freeze)
