"""The interface of trackers: one copy of a sweep, written by one process at a time, which can always be rebuilt."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from pathlib import Path
from typing import TYPE_CHECKING, ClassVar, Protocol

from orchestrator.results.records.record import Head, Record
from orchestrator.results.sweep_folder import Results

if TYPE_CHECKING:
    from orchestrator.analysis.findings import Findings


class TrackingBackend(Protocol):
    """A sweep's copy. Writes are idempotent, since a resumed sweep and `deltatune sync` repeat them.

    Any method may raise; the sweep continues, and what is missing is written at its end or by `deltatune sync`.
    """

    errors: ClassVar[tuple[type[Exception], ...]]
    """Raised where the copy cannot be written."""

    parent: str
    """The name of the copy: a run's id or a file."""

    def __init__(self, results: Results, uri: str, check: Callable[[], None] = ...) -> None:
        """Open the copy of a sweep at `uri`, creating it where it is missing.

        check: call it before each write; it raises OSError where another process may have taken over the writing.
        """

    def write_configurations(self, findings: Findings) -> None:
        """Write the statistics of the configurations before further cells, where readers need them at once."""

    def write_cell(self, stage: str, head: Head, read: Callable[[], Record | None]) -> None:
        """Write an ended cell, unless the copy has it; `read` returns its record with the curve."""

    def finish(self, findings: Findings, artifacts: Iterable[Path]) -> None:
        """Write files, and what else is missing, once all cells are written; remove what the sweep no longer has."""

    def end(self, status: str) -> None:
        """Note that the sweep stopped early: KILLED by request, FAILED by an error."""
