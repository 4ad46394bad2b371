"""The configurations of a cell, known before its sweep has ended."""

from __future__ import annotations

from orchestrator.planning.arms import PLAIN, configuration_id
from orchestrator.results.sweep_folder import Labels, Results
from trainables.cell import Cell


class Configurations:
    """The configurations of a sweep's cells, from its plan; each stage of the plan is read once."""

    def __init__(self, results: Results) -> None:
        self._results = results
        self._labels: dict[str, Labels] = {}

    def of(self, stage: str, cell: Cell) -> list[str]:
        """Return the ids of a cell's configurations, one for each of its arms."""
        if stage not in self._labels:
            self._labels = self._results.labels()
            self._labels.setdefault(stage, {})
        return list(
            dict.fromkeys(configuration_id(cell, label) for label in self._labels[stage].get(cell.id) or (PLAIN,))
        )
