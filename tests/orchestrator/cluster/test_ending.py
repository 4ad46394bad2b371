"""Ray's references are freed before it shuts down beside other work, or after, and never meanwhile."""

from __future__ import annotations

import gc
import threading

import pytest

from orchestrator.cluster import ending

FREED: list[str] = []


class Reference:
    """One of Ray's, in a cycle that only the garbage collector frees."""

    def __init__(self, name: str) -> None:
        self.name, self.cycle = name, self

    def __del__(self) -> None:
        FREED.append(self.name)


def test_nothing_is_freed_while_ray_shuts_down() -> None:
    FREED.clear()
    begun, may_end = threading.Event(), threading.Event()
    freed_before: list[str] = []

    def shutdown() -> None:
        freed_before.extend(FREED)
        begun.set()
        assert may_end.wait(60)

    Reference("before")
    ending.end(shutdown)
    assert begun.wait(60)
    Reference("meanwhile")
    for _ in range(200_000):  # more than any threshold
        [[]].append([])
    kept = [[number] for number in range(200_000)]
    assert FREED == freed_before == ["before"]
    may_end.set()
    ending.wait()
    assert gc.isenabled()
    del kept
    gc.collect()
    assert FREED == ["before", "meanwhile"]


@pytest.mark.filterwarnings("ignore::pytest.PytestUnhandledThreadExceptionWarning")
def test_a_shutdown_that_fails_leaves_the_collector_on() -> None:
    def broken() -> None:
        raise SystemExit  # with which a thread ends without a word

    ending.end(broken)
    ending.wait()
    assert gc.isenabled()
