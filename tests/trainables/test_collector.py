"""The garbage collector of a process, set once however often it is asked for."""

from __future__ import annotations

import atexit
import gc
from collections.abc import Callable, Iterator

import pytest

from trainables.collector import THRESHOLDS, collect_seldom


@pytest.fixture
def thresholds() -> Iterator[None]:
    before = gc.get_threshold()
    collect_seldom.cache_clear()
    yield
    gc.set_threshold(*before)
    collect_seldom.cache_clear()


def test_a_worker_of_many_trials_registers_one_exit_function(thresholds: None, monkeypatch: pytest.MonkeyPatch) -> None:
    registered: list[Callable[[], None]] = []
    monkeypatch.setattr(atexit, "register", registered.append)
    for _ in range(3):
        collect_seldom()
    assert gc.get_threshold() == THRESHOLDS
    assert registered == [gc.freeze]
