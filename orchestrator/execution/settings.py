"""How a sweep is to run, and what a run of it did."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

from orchestrator.cluster.resources import Resources
from orchestrator.planning.arms import Params
from orchestrator.planning.source_choice import Runs
from orchestrator.results.records.record import Record

OnRecord = Callable[[str, Record], None]
"""Is told the stage and the record of each cell as it ends."""


@dataclass(frozen=True)
class Settings:
    """How a sweep runs; nothing here decides a result but `params`, which settles hyperparameters, and `pretrained`."""

    workers: int | None = None
    """Cells at a time; None: as many as there are CPUs for."""
    address: str | None = None
    """A running Ray cluster; None: this machine."""
    local: bool = False
    """Without Ray: in this process where `workers` is 1, else in that many processes beside it."""
    retry_failed: bool = False
    checkpoint_seconds: float = 5.0
    """Time between the checkpoints of a long cell."""
    time_limit: float | None = None
    """Seconds that a cell may take; what takes longer fails."""
    resources: Resources = field(default_factory=Resources)
    params: Params = field(default_factory=dict)
    pretrained: Runs = field(default_factory=dict)
    """Sources that are not trained here."""


@dataclass
class RunSummary:
    """What a run of a sweep did."""

    ran: int = 0
    failed: int = 0
    stopped: int = 0
    """Cells that a scheduler ended early."""
    reused: int = 0
    """Cells that had ended before."""
    training_seconds: float = 0.0
    """Summed over the cells that ran."""
    seconds: float = 0.0
    workers: int = 0
    left: int = 0
    """Cells that an interruption has left."""

    def ended(self, record: Record) -> None:
        """Count an ended cell."""
        self.ran += 1
        self.failed += record.status == "failed"
        self.stopped += record.status == "stopped"
        self.training_seconds += record.seconds
