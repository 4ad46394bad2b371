"""One thread per worker, since a sweep uses the cores for several cells, not for the threads of one."""

from __future__ import annotations

import sys

from threadpoolctl import threadpool_limits


def one_thread() -> None:
    """Limit BLAS, OpenMP and torch in this process to one thread each; they still choose their kernels.

    The compiled agents use none of them, so this affects the speed of other work, never the agents' results.
    """
    threadpool_limits(limits=1)
    torch = sys.modules.get("torch")
    if torch is not None:
        torch.set_num_threads(1)
