"""What a tracker is: the copy of one sweep in one place, written by one process at a time and rebuilt at any time."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from pathlib import Path
from typing import TYPE_CHECKING, ClassVar, Protocol

from orchestrator.results.records.record import Head, Record
from orchestrator.results.sweep_folder import Results

if TYPE_CHECKING:
    from orchestrator.analysis.findings import Findings


class TrackingBackend(Protocol):
    """A sweep's copy. Whatever is written twice changes nothing: a resumed sweep and `deltatune sync` write all again.

    Any method may raise; the sweep goes on, and what is missing is written at its end or by `deltatune sync`.
    """

    errors: ClassVar[tuple[type[Exception], ...]]
    """What is raised where the place cannot be written to."""

    parent: str
    """The name of the copy: a run's id, a file."""

    def __init__(self, results: Results, uri: str) -> None:
        """Open the copy of a sweep at `uri`, made where it is missing, to go on with it."""

    def write_cell(self, stage: str, head: Head, read: Callable[[], Record | None]) -> None:
        """Write an ended cell, unless it is there already; `read` gets its record with the curve."""

    def finish(self, findings: Findings, artifacts: Iterable[Path]) -> None:
        """Write what is known once all cells are written: configurations, files; drop what the sweep has no more."""

    def end(self, status: str) -> None:
        """Note that the sweep has stopped before its end: KILLED by a wish, FAILED by an error."""
