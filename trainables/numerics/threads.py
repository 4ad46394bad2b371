"""One thread per worker: a sweep keeps every core busy with cells, not with threads of one cell."""

from __future__ import annotations

import sys

from threadpoolctl import threadpool_limits


def one_thread() -> None:
    """Limit BLAS, OpenMP and torch in this process to one thread each; which kernels they choose stays theirs.

    The compiled agents use none of them, so this changes how fast other work runs, never a result of theirs.
    """
    threadpool_limits(limits=1)
    torch = sys.modules.get("torch")
    if torch is not None:
        torch.set_num_threads(1)
