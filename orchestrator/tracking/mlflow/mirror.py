"""The copy of a sweep in MLflow: written by one process, from the results alone, so that it can always be rebuilt.

    experiment          the family of sweeps
      run, kind=sweep       the sweep: description, table, figures and best.yaml as artifacts
        run, kind=aggregate   one per (task, agent, source, hyperparameters): mean, sd and interval over seeds
        run, kind=cell        one per cell: parameters, curves, provenance

Here is what they say; `runs.py` finds and writes them.
"""

from __future__ import annotations

import json
import logging
import time
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import ClassVar

import pandas as pd
from mlflow.entities import Metric, RunTag
from mlflow.exceptions import MlflowException

from orchestrator.analysis.curves.bands import NO_CURVE, mean_curves
from orchestrator.analysis.findings import Findings
from orchestrator.analysis.groups import Group
from orchestrator.analysis.labels import cell_name, configuration_name, group_name
from orchestrator.analysis.tables.summary_table import number_table
from orchestrator.results.records.record import Head, Record
from orchestrator.results.sweep_folder import Results
from orchestrator.results.tables.cell_row import cell_row
from orchestrator.tracking.configurations import Configurations
from orchestrator.tracking.mlflow.description import markdown
from orchestrator.tracking.mlflow.experiment import find_experiment
from orchestrator.tracking.mlflow.fields import CELL_METRICS, cell_tags, group_figures, places, sweep_metrics
from orchestrator.tracking.mlflow.inputs import TABLE, tasks_of
from orchestrator.tracking.mlflow.runs import Content, SweepRuns, sweep_id
from orchestrator.tracking.mlflow.store import connect
from trainables.cell import Cell, content_id
from trainables.storage.folders import local_copy

logging.getLogger("mlflow").setLevel(logging.WARNING)  # keeps its lines on database tables out of the display

LOGGED_TABLES = "mlflow.loggedArtifacts"
"""The tag by which MLflow's pages find a run's tables."""

_NO_CURVE = ("episode", "step", "seconds", "discounted_return")
"""Columns of a record without a curve in MLflow."""


class Mirror:
    """A sweep's copy in one MLflow store: the TrackingBackend of MLflow."""

    errors: ClassVar[tuple[type[Exception], ...]] = (MlflowException, OSError)

    def __init__(self, results: Results, uri: str, check: Callable[[], None] = lambda: None) -> None:
        self._results, self._configurations = results, Configurations(results)
        self._meta = meta = results.meta()
        connected, family = connect(uri), meta["space"]["family"] or meta["space"]["name"]
        check()
        experiment = find_experiment(connected, uri, family, results.storage / "mlartifacts")
        identity = {"sweep": results.name, "sweep_id": sweep_id(results.name, meta["created"])}
        self._runs = SweepRuns(connected, experiment, identity, check)
        self.parent = self._find_parent()

    def write_cell(self, stage: str, head: Head, read: Callable[[], Record | None]) -> None:
        """Write the run of an ended cell, unless it exists; `read` returns the whole record."""
        cell, key = head.cell, ("cell", head.cell.id)
        digest = content_id([head.digest, head.status])
        if self._runs.holds(key, digest) or (record := read()) is None:
            return
        row = cell_row(stage, cell, head)
        episodes = record.points.get("episode", [])
        curves = {name: values for name, values in record.points.items() if name not in _NO_CURVE}
        groups = self._configurations.of(stage, cell)
        content = Content(
            name=cell_name(cell),
            tags=cell_tags(stage, head) | {"digest": digest, "of_group": ", ".join(groups)},
            params=cell.hyperparameters,
            metrics={name: row[name] for name in CELL_METRICS if row.get(name) is not None},
            curves={name: list(zip(episodes, values, strict=True)) for name, values in curves.items()},
            finished=head.finished,
            seconds=head.seconds,
            status={"failed": "FAILED", "done": "FINISHED"}.get(head.status, "KILLED"),
            above=self._aggregate(groups[0], cell),
        )
        self._runs.write(key, content)

    def _aggregate(self, group: str, cell: Cell) -> str:
        """Return the run under which a cell is nested, created where it is missing; `finish` adds its statistics."""
        known = self._runs.known.get(("aggregate", group))
        if known is None:
            source = cell.sources[0].kind if cell.sources else "none"
            name = configuration_name(cell.task, cell.agent, source, cell.hyperparameters)
            known = self._runs.begin(("aggregate", group), name, {}, self._meta["created"], self.parent)
        return known.run_id

    def write_configurations(self, findings: Findings) -> None:
        """Write the aggregate runs: with them the leaderboard is complete, while the cells may take minutes."""
        groups = [*findings.groups, *findings.confirmations]
        curves, ranks = mean_curves(findings.points, findings.cells), places(groups)
        for group in groups:
            self.write_group(group, curves.get(group.id, NO_CURVE), ranks.get(group.id))

    def write_group(self, group: Group, curve: pd.DataFrame, place: str | None) -> None:
        """Write the aggregate run of one group; a run with older statistics is replaced."""
        metrics, tags = group_figures(group)
        digest = content_id([metrics, tags, curve.to_csv()])
        content = Content(
            name=group_name(group),
            tags=tags | {"digest": digest} | ({"place": place} if place else {}),
            params=group.hyperparameters,
            metrics=metrics,
            curves={
                f"greedy_return_{n}": list(zip(curve["episode"], curve[n], strict=True))
                for n in ("mean", "low", "high")
            },
            finished=self._meta["created"],
            status="FINISHED",
            above=self.parent,
            inputs=tasks_of(group),
        )
        self._runs.write(("aggregate", group.id), content)
        self._runs.place(("aggregate", group.id), place)

    def finish(self, findings: Findings, artifacts: Iterable[Path]) -> None:
        """Write the description, figures and files of the sweep's run, and put the cells below their aggregates."""
        cells, every, runs = findings.cells, [*findings.groups, *findings.confirmations], self._runs
        for cell_id, groups in cells.groupby("cell_id")["group"].agg(list).items() if len(cells) else ():
            runs.nest(("cell", str(cell_id)), groups)
        description = markdown(self._results, findings.groups, findings.best)
        runs.client.set_tag(self.parent, "mlflow.note.content", description)
        self._log_sweep_metrics(sweep_metrics(findings.best))
        self._log_table(findings)
        for path in artifacts:
            folder = Path(path.parent.relative_to(self._results.folder).as_posix())
            with local_copy(path) as file:
                runs.client.log_artifact(self.parent, str(file), None if folder == Path(".") else str(folder))
        planned = [("cell", str(cell_id)) for cell_id in cells["cell_id"]]
        runs.keep([("sweep", ""), *planned, *(("aggregate", group.id) for group in every)])
        runs.client.log_batch(self.parent, tags=[RunTag(*tag) for tag in self._sweep_tags(findings).items()])
        runs.client.set_terminated(self.parent)

    def _sweep_tags(self, findings: Findings) -> dict[str, str]:
        """Return the tags of the sweep's run that tell its size."""
        space, counts = self._meta["space"], findings.each_cell["status"].value_counts()
        targets = ", ".join(target for scenario in space["scenarios"] for target in scenario["targets"])
        tags = {f"cells_{status}": str(counts.get(status, 0)) for status in ("done", "failed", "stopped", "missing")}
        return tags | {
            "seeds": str(len(space["seeds"])),
            "agents": ", ".join(space["agents"]),
            "targets": targets[:5000],
        }

    def _log_table(self, findings: Findings) -> None:
        """Write every configuration's numbers as MLflow's own kind of table; `log_table` would append to an old one."""
        if not findings.groups:
            return
        text = number_table(findings.groups).to_json(orient="split", index=False)
        self._runs.client.log_text(self.parent, text, TABLE)
        self._runs.client.set_tag(self.parent, LOGGED_TABLES, json.dumps([{"path": TABLE, "type": "table"}]))

    def _log_sweep_metrics(self, metrics: Mapping[str, float]) -> None:
        """Log the metrics of the sweep's run, except those that it has already."""
        there = self._runs.client.get_run(self.parent).data.metrics
        stamp = int(time.time() * 1000)
        new = [Metric(name, value, stamp, 0) for name, value in metrics.items() if there.get(name) != value]
        if new:
            self._runs.client.log_batch(self.parent, new)

    def end(self, status: str) -> None:
        """Set the status of a sweep that stopped early: KILLED by request, FAILED by an error."""
        self._runs.client.set_terminated(self.parent, status)
        for (kind, _), known in self._runs.known.items():
            if kind == "aggregate" and not known.whole:
                self._runs.client.set_terminated(known.run_id, status)

    def _find_parent(self) -> str:
        known = self._runs.known.get(("sweep", ""))
        if known is not None:
            self._runs.client.update_run(known.run_id, status="RUNNING")
            return known.run_id
        meta = self._meta
        tags = {"space": meta["space"]["name"], "commit": meta["commit"]}
        tags |= {f"version.{name}": version for name, version in meta["versions"].items()}
        return self._runs.begin(("sweep", ""), self._results.name, tags, meta["created"], None).run_id
