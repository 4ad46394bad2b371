"""The results of a sweep in Python: data frames and figures, read from its files alone."""

from __future__ import annotations

import io
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any

import pandas as pd

from orchestrator.analysis.contrasts import decisions
from orchestrator.analysis.contrasts.table import number_table
from orchestrator.analysis.curves.bands import curve_bands
from orchestrator.analysis.findings import Findings, find
from orchestrator.analysis.groups import Group
from orchestrator.analysis.over_tasks import number_table as standings
from orchestrator.analysis.tables.summary_table import numbers
from orchestrator.results.sweep_folder import Results
from trainables.storage.paths import default_storage, storage_path


def load(name: str, storage: str | Path | None = None) -> SweepResults:
    """Return the results of the sweep `name` in `storage` (default: DELTATUNE_STORAGE, else the folder `results`).

    Raises InputError, with the list of what there is, for an unknown sweep.
    """
    return SweepResults(Results.open(storage_path(storage or default_storage()), name))


@dataclass(frozen=True, eq=False)
class Picture:
    """A figure that a notebook displays."""

    figure: Any
    """A matplotlib Figure, which can be changed, and saved with `savefig`."""

    def _repr_png_(self) -> bytes:
        data = io.BytesIO()
        self.figure.savefig(data, format="png", dpi=120)
        return data.getvalue()


@dataclass(frozen=True, eq=False)
class SweepResults:
    """A sweep's results. A notebook shows it as its table of best configurations."""

    files: Results = field(repr=False)

    @property
    def name(self) -> str:
        """The sweep's name."""
        return self.files.name

    @property
    def folder(self) -> Path:
        """Where its files are."""
        return self.files.folder

    @cached_property
    def findings(self) -> Findings:
        """Its tables, groups and selection, from which figures and exports are made."""
        return find(self.files)

    @property
    def cells(self) -> pd.DataFrame:
        """One row per cell that the sweep asks for."""
        return self.findings.cells

    @property
    def points(self) -> pd.DataFrame:
        """One row per cell and greedy evaluation."""
        return self.findings.points

    @property
    def table(self) -> pd.DataFrame:
        """One row per configuration: AUC, transfer ratio and difference with their intervals, verdict."""
        return _frame(self.findings.groups)

    @property
    def best(self) -> pd.DataFrame:
        """The rows of `table` with the best configuration of each task, agent and source."""
        return _frame(self.findings.best)

    @property
    def contrasts(self) -> pd.DataFrame:
        """One row per comparison between agents, delta_es - es first, p-values plain and corrected by Holm."""
        return number_table(self.findings.contrasts)

    @property
    def decisions(self) -> pd.DataFrame:
        """One row per comparison of a sequential test over seeds (`seeds: auto`); empty where the seeds are fixed."""
        return decisions.number_table(self.findings.decisions)

    def contrast(self, first: str, second: str, early: bool = False) -> pd.DataFrame:
        """Return the differences first - second between two agents on every target, paired by seed.

        early: in the AUC until the advice ends. Raises InputError for what is no agent of the sweep.
        """
        return number_table(self.findings.contrast(first, second, measure="early_auc" if early else "auc"))

    @property
    def over_tasks(self) -> pd.DataFrame:
        """One row per agent over all tasks with reference values: interquartile mean and other aggregates."""
        return standings(self.findings.over_tasks)

    def curves(self) -> pd.DataFrame:
        """Return the mean evaluation curve of each best configuration, with its 95 % interval over seeds."""
        best, column = self.findings.best, "greedy_return"
        bands = curve_bands(self.points, self.cells, [group.id for group in best], [column])
        frames = [
            bands[group.id, column].assign(task=group.task, agent=group.agent, source=group.source) for group in best
        ]
        columns = ["task", "agent", "source", "episode", "mean", "low", "high"]
        return pd.concat(frames, ignore_index=True)[columns] if frames else pd.DataFrame(columns=columns)

    def figures(self) -> dict[str, Picture]:
        """Return the report's figures by name; a notebook displays each."""
        from dashboards.renderers.matplotlib_renderer import drawing
        from dashboards.report.sections import figures

        drawn = {figure.name: drawing(figure, self.name) for figure in figures(self.findings)}
        return {name: Picture(sheet) for name, sheet in drawn.items() if sheet is not None}

    def _repr_html_(self) -> str:
        """Return the best configurations as an HTML table, for notebooks."""
        html: str = self.best.to_html(index=False, float_format=lambda value: f"{value:.3g}")
        return html


def _frame(groups: Sequence[Group]) -> pd.DataFrame:
    """Return groups as a table of numbers; `hyperparameters` is JSON text, `group` the group id of the cells."""
    return pd.DataFrame([numbers(group) | {"group": group.id} for group in groups])
