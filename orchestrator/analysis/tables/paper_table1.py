"""Table 1 of the paper, and the groups that correspond to its rows."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

from orchestrator.analysis.groups import Group
from orchestrator.analysis.labels import varied
from trainables.tasks.registry import parse_task


@dataclass(frozen=True)
class PaperRow:
    """AUC over five seeds, and the transfer ratio of the means in percent as printed (None in the row of DQN)."""

    auc: float
    sd: float
    transfer_ratio: float | None = None

    def __str__(self) -> str:
        """Return '157.0 (11.1), +12.9%'."""
        digits = 2 if abs(self.auc) < 10 else 1
        ratio = "" if self.transfer_ratio is None else f", {self.transfer_ratio:+.1f}%"
        return f"{self.auc:.{digits}f} ({self.sd:.{digits}f}){ratio}"


TABLE_1 = {
    "cartpole:gravity=5x": (PaperRow(139.4, 11.7), PaperRow(157.0, 11.1, 12.9), PaperRow(163.8, 14.1, 17.8)),
    "cartpole:gravity=7x": (PaperRow(131.8, 10.9), PaperRow(127.6, 14.2, -2.9), PaperRow(158.6, 2.4, 21.0)),
    "acrobot:link_mass=1.5": (PaperRow(-172.7, 26.9), PaperRow(-161.3, 14.4, 6), PaperRow(-150.1, 5.0, 13.0)),
    "acrobot:link_mass=2": (PaperRow(-228.6, 12.0), PaperRow(-233.0, 20.4, -1.9), PaperRow(-228.4, 15.6, 0.1)),
    "lunar_lander:mass=1.1": (PaperRow(178.3, 13.8), PaperRow(171.1, 7.8, -4), PaperRow(181.5, 7.4, 1.7)),
    "lunar_lander:mass=0.75": (PaperRow(223.5, 6.8), PaperRow(219.8, 11.0, -1.63), PaperRow(228.0, 5.0, 3.70)),
    "reacher:y_force=0.75": (PaperRow(-5.96, 0.1), PaperRow(-5.71, 0.1, 3.9), PaperRow(-5.66, 0.08, 4.8)),
    "reacher:y_force=1": (PaperRow(-6.38, 0.28), PaperRow(-6.17, 0.09, 3.3), PaperRow(-6.09, 0.22, 4.4)),
}
"""Target task to its rows for AGENTS, in that order."""

AGENTS = ("dqn", "es", "delta_es")

SHARE = 0.25
"""The advice fraction of Table 1 (Appendix C)."""

OURS_TO_CHOOSE = {"learning_rate", "advice_fraction"}
"""Hyperparameters that a row of Table 1 leaves open: the paper sweeps the one and states the other per row."""


@cache
def _rows() -> dict[tuple[str, str], PaperRow]:
    return {
        (parse_task(task).name, agent): row
        for task, rows in TABLE_1.items()
        for agent, row in zip(AGENTS, rows, strict=True)
    }


def table_1(group: Group) -> PaperRow | None:
    """Return the paper's row for the group's target, agent and advice fraction, whatever the rest; or None."""
    if group.hyperparameters.get("advice_fraction", SHARE) != SHARE:
        return None
    return _rows().get((group.task, group.agent))


def same_row(group: Group) -> PaperRow | None:
    """Return `table_1` of a group with all of the paper's settings (episodes, network, ...) and a learned source."""
    changed = set(varied(group.agent, group.task, group.hyperparameters))
    return table_1(group) if changed <= OURS_TO_CHOOSE and group.source != "exact" else None
