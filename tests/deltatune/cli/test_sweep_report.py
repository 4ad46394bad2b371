"""The last lines of a sweep."""

from __future__ import annotations

import pytest

from deltatune.cli.sweep_report import _overhead
from orchestrator.execution.settings import RunSummary


@pytest.mark.parametrize(
    ("trained", "workers", "said"),
    [
        (15.0, 2, ", 25 % of it overhead"),
        (0.0, 0, ", 100 % of it overhead"),
        (20.5, 2, ""),  # cells that an interrupted run had begun
    ],
)
def test_overhead_is_never_negative(trained: float, workers: int, said: str) -> None:
    assert _overhead(RunSummary(training_seconds=trained, workers=workers), 10.0) == said
