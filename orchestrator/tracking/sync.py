"""Synchronises a tracker with a sweep's results table."""

from __future__ import annotations

import logging
from collections.abc import Iterable
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from orchestrator.errors import SweepError
from orchestrator.tracking.backend import TrackingBackend
from orchestrator.tracking.trackers import kind_of
from orchestrator.tracking.uri import shown

if TYPE_CHECKING:
    from orchestrator.analysis.findings import Findings

log = logging.getLogger("deltatune.tracking")


def sync(findings: Findings, uri: str, artifacts: Iterable[Path], backend: TrackingBackend | None = None) -> str:
    """Write what is missing, replace what has changed, and return the copy's name (in MLflow, the parent run's id)."""
    results = findings.results
    backend = backend or kind_of(uri).load()(results, uri)
    try:
        backend.write_configurations(findings)
        for stage, cell, head in results.planned_heads():
            if head is not None:
                backend.write_cell(stage, head, partial(results.log.record, cell.id))
        backend.finish(findings, artifacts)
    except BaseException as stopped:
        try:
            backend.end("FAILED" if isinstance(stopped, Exception) else "KILLED")
        except Exception as error:  # an unreachable store
            log.info("the sweep's status is not written to %s: %s", shown(uri), error)
        raise
    return backend.parent


def sync_now(findings: Findings, uri: str, artifacts: Iterable[Path]) -> str:
    """Do the same as `sync` from the command line.

    Raises InputError where another process, such as the driver, is writing the sweep there; SweepError where the store
    does not answer.
    """
    kind = kind_of(uri)
    backend = kind.load()
    try:
        with kind.held(findings.results.folder) as hold:
            return sync(findings, uri, artifacts, backend(findings.results, uri, hold.check_surely))
    except backend.errors as error:
        raise SweepError(f"{kind.title} at {shown(uri)} cannot be written to: {str(error).splitlines()[0]}") from None
