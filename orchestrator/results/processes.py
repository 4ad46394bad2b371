"""Which process this is, on which boot of which machine, and whether another one still runs."""

from __future__ import annotations

import os
from contextlib import suppress
from functools import lru_cache
from pathlib import Path


@lru_cache(maxsize=1)
def machine() -> str:
    """Return an identifier of this boot of the machine and of the container, since host names are not unique."""
    parts = [os.uname().nodename]
    with suppress(OSError):
        parts.append(Path("/proc/sys/kernel/random/boot_id").read_text().strip())
        parts.append(str(os.stat("/proc/self/ns/pid").st_ino))
    return ":".join(parts)


def started_at(pid: int) -> str | None:
    """Return a process's start time in the system's units; empty for a dead process, None where it is unknown."""
    with suppress(OSError, IndexError):
        state, *fields = Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()
        return "" if state in "ZX" else fields[18]
    return None


def runs(pid: int, started: str | None) -> bool:
    """Return whether the process `pid` that was started at `started` (None: whenever) still runs."""
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    except PermissionError:
        pass
    now = started_at(pid)
    return started is None or now is None or started == now
