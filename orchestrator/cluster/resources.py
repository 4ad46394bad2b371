"""The resources of a cell, and the CPUs of this machine."""

from __future__ import annotations

import os
from dataclasses import dataclass


@dataclass(frozen=True)
class Resources:
    """What Ray reserves for a cell; fractions let several cells share a CPU or a GPU."""

    cpus: float = 1.0
    gpus: float = 0.0
    memory_gib: float = 0.0
    """0: none is reserved."""

    def request(self) -> dict[str, float]:
        """Return the request for Ray: CPU, GPU, and memory in bytes, without zeros."""
        wanted = {"CPU": self.cpus, "GPU": self.gpus, "memory": self.memory_gib * 2**30}
        return {name: amount for name, amount in wanted.items() if amount}


def local_cpus() -> int:
    """Return the number of CPUs that this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1
