"""The settings of a run of a sweep, and its summary."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

from orchestrator.cluster.resources import Resources
from orchestrator.execution.defaults import CHECKPOINT_SECONDS, KEEP_STATES, Reuse
from orchestrator.planning.arms import Params
from orchestrator.planning.source_choice import Runs
from orchestrator.results.records.record import Record

OnRecord = Callable[[str, Record], None]
"""Called with the stage and the record of each cell as it ends."""

LIBRARY = "the source library"
"""Where sources that another sweep has trained come from; other cells come from the sweep of a name."""


def origins(taken: Mapping[str, int]) -> str:
    """Return where copied cells come from, as text: '2 taken from the source library, 28 from the sweep try'."""
    places = [f"{n:,} from {where if where == LIBRARY else f'the sweep {where}'}" for where, n in taken.items()]
    return ", ".join(places).replace(" from", " taken from", 1)


@dataclass(frozen=True)
class Settings:
    """How a sweep runs. Only `params`, which fixes hyperparameters, and `pretrained` affect its results."""

    workers: int | None = None
    """Cells at a time; None: one per CPU."""
    address: str | None = None
    """A running Ray cluster; None: this machine."""
    local: bool = False
    """Whether to run without Ray: in this process if `workers` is 1, else in that many worker processes."""
    retry_failed: bool = False
    reuse: Reuse = "sources"
    checkpoint_seconds: float = CHECKPOINT_SECONDS
    keep_states: float = KEEP_STATES
    time_limit: float | None = None
    """Seconds after which a cell fails; None: no limit."""
    resources: Resources = field(default_factory=Resources)
    params: Params = field(default_factory=dict)
    pretrained: Runs = field(default_factory=dict)
    """Pretrained sources, which stage 1 does not train."""


@dataclass
class RunSummary:
    """The counts and times of one run of a sweep."""

    ran: int = 0
    failed: int = 0
    stopped: int = 0
    """Cells that a scheduler stopped early."""
    reused: int = 0
    """Cells that had ended in earlier runs, or elsewhere."""
    taken: dict[str, int] = field(default_factory=dict)
    """How many of these were copied, by the sweep that has trained them; sources: by 'the source library'."""
    continued: int = 0
    """Cells that went on from the end state of a shorter one."""
    training_seconds: float = 0.0
    """Summed over the cells that ran; what they continue is not counted."""
    seconds: float = 0.0
    workers: int = 0
    left: int = 0
    """Cells left to run after an interruption."""

    def took(self, taken: Mapping[str, int]) -> None:
        """Count copied cells."""
        for where, count in taken.items():
            self.taken[where] = self.taken.get(where, 0) + count

    def ended(self, record: Record, continued: bool = False, earlier_seconds: float = 0.0) -> None:
        """Count an ended cell, whose seconds are earlier ones in part where it was resumed or continues another."""
        self.ran += 1
        self.continued += continued
        self.failed += record.status == "failed"
        self.stopped += record.status == "stopped"
        self.training_seconds += record.seconds - earlier_seconds
