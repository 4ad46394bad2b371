"""What is kept of trials while a stage runs."""

from __future__ import annotations

import gc
import weakref
from unittest import mock

import pytest

from orchestrator.execution.executors.monitor import StageMonitor
from orchestrator.execution.work_queue import CellStatus, Pack, WorkQueue
from trainables import curve
from trainables.cell import Cell
from trainables.training.messages import Reached


class Marked(float):
    """A number that can be watched."""


@pytest.mark.parametrize("lost", [False, True], ids=["ends", "is lost"])
def test_the_curve_of_a_configuration_is_forgotten_once_its_trial(lost: bool) -> None:
    cell = Cell.create("q_learning", "windy_gridworld", 0, {"episodes": 10})
    queue = WorkQueue(CellStatus(lambda cell: False, lambda cells: None), None, packs=[Pack((cell,), together=True)])
    monitor = StageMonitor(queue, mock.Mock(), mock.Mock(), None, set())
    assert monitor.next("trial") is not None
    value = Marked(1.0)
    watched = weakref.ref(value)
    points = {name: [0] for name in curve.FIELDS} | {"greedy_return": [value]}
    monitor.on_report("trial", Reached(1, 1.0, ((cell.id, points),)))
    del value, points
    gc.collect()
    assert watched() is not None, "early stopping may ask for it"
    if lost:
        monitor.on_lost("trial", "gone")
    else:
        monitor.on_completed("trial")
    gc.collect()
    assert watched() is None
