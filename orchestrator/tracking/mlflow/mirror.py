"""The copy of a sweep in MLflow: written by one process, from the results alone, so that it can always be rebuilt.

    experiment          the family of sweeps
      run, kind=sweep       the sweep: description, table, figures and best.yaml as artifacts
        run, kind=aggregate   one per (task, agent, source, hyperparameters): mean, sd and interval over seeds
        run, kind=cell        one per cell: parameters, curves, provenance

A run is identified by its tags (`sweep_id` with `cell_id` or `group`), and its `digest` tag by its content; so writing
twice changes nothing. A run that was interrupted (its status is still RUNNING) is written again with the same time
stamps, which MLflow stores once.
"""

from __future__ import annotations

import json
import logging
import math
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, ClassVar, NamedTuple

import pandas as pd
from mlflow.entities import DatasetInput, Metric, Param, Run, RunTag
from mlflow.exceptions import MlflowException
from mlflow.tracking import MlflowClient

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
from orchestrator.tracking.mlflow.fields import CELL_METRICS, cell_tags, group_figures, places, sweep_metrics, thinned
from orchestrator.tracking.mlflow.inputs import TABLE, tasks_of
from orchestrator.tracking.mlflow.store import connect
from trainables.cell import Cell, content_id
from trainables.storage.folders import local_copy

logging.getLogger("mlflow").setLevel(logging.WARNING)  # keeps its lines on database tables out of the display

PARENT = "mlflow.parentRunId"
"""The tag by which MLflow nests a run under another."""

LOGGED_TABLES = "mlflow.loggedArtifacts"
"""The tag by which MLflow's pages find a run's tables."""

BATCH = 800
"""Metrics per call, which may hold 1000 items; the first call has parameters and tags too."""


_NO_CURVE = ("episode", "step", "seconds", "discounted_return")
"""Columns of a record without a curve in MLflow."""


def sweep_id(name: str, created: float) -> str:
    """Return the tag by which the runs of a sweep are found."""
    return content_id([name, created])


class _Known(NamedTuple):
    """An existing run."""

    run_id: str
    digest: str | None
    """Identifies its content; None for the sweep's run, and for an aggregate without statistics yet."""
    whole: bool
    """False: it was interrupted."""
    parent: str | None = None
    """The run under which it is nested."""
    groups: str | None = None
    """The configurations of a cell."""


class Mirror:
    """A sweep's copy in one MLflow store: the TrackingBackend of MLflow."""

    errors: ClassVar[tuple[type[Exception], ...]] = (MlflowException, OSError)

    def __init__(self, results: Results, uri: str, check: Callable[[], None] = lambda: None) -> None:
        self._check = check
        self._results, self._configurations = results, Configurations(results)
        meta = results.meta()
        self._sweep_id = sweep_id(results.name, meta["created"])
        self._meta = meta
        self._connected = connect(uri)
        self._experiment = find_experiment(
            self._client, uri, meta["space"]["family"] or meta["space"]["name"], results.storage / "mlartifacts"
        )
        self._known = {
            self._key(run.data.tags): _Known(
                str(run.info.run_id),
                run.data.tags.get("digest"),
                run.info.status != "RUNNING",
                run.data.tags.get(PARENT),
                run.data.tags.get("of_group"),
            )
            for run in self._runs()
        }
        self.parent = self._find_parent()

    @property
    def _client(self) -> MlflowClient:
        """The client for one request, which only the one who writes this sweep may make."""
        self._check()
        return self._connected

    def write_cell(self, stage: str, head: Head, read: Callable[[], Record | None]) -> None:
        """Write the run of an ended cell, unless it exists; `read` returns the whole record."""
        cell, key = head.cell, ("cell", head.cell.id)
        digest = content_id([head.digest, head.status])
        if self._holds(key, digest) or (record := read()) is None:
            return
        row = cell_row(stage, cell, head)
        episodes = record.points.get("episode", [])
        curves = {name: values for name, values in record.points.items() if name not in _NO_CURVE}
        groups = self._configurations.of(stage, cell)
        self._write(
            key,
            cell_name(cell),
            cell_tags(stage, head) | {"digest": digest, "of_group": ", ".join(groups)},
            cell.hyperparameters,
            {name: row[name] for name in CELL_METRICS if row.get(name) is not None},
            {name: list(zip(episodes, values, strict=True)) for name, values in curves.items()},
            head.finished,
            head.seconds,
            "FAILED" if head.status == "failed" else "FINISHED" if head.status == "done" else "KILLED",
            self._aggregate(groups[0], cell),
        )

    def _aggregate(self, group: str, cell: Cell) -> str:
        """Return the run under which a cell is nested, created where it is missing; `finish` adds its statistics."""
        known = self._known.get(("aggregate", group))
        if known is None:
            source = cell.sources[0].kind if cell.sources else "none"
            name = configuration_name(cell.task, cell.agent, source, cell.hyperparameters)
            known = self._begin(("aggregate", group), name, {}, self._meta["created"], self.parent)
        return known.run_id

    def write_group(self, group: Group, curve: pd.DataFrame) -> None:
        """Write the aggregate run of one group; a run with older statistics is replaced."""
        metrics, tags = group_figures(group)
        content = content_id([metrics, tags, curve.to_csv()])
        curves = {
            f"greedy_return_{n}": list(zip(curve["episode"], curve[n], strict=True)) for n in ("mean", "low", "high")
        }
        self._write(
            ("aggregate", group.id),
            group_name(group),
            tags | {"digest": content},
            group.hyperparameters,
            metrics,
            curves,
            self._meta["created"],
            0.0,
            "FINISHED",
            self.parent,
            tasks_of(group),
        )

    def finish(self, findings: Findings, artifacts: Iterable[Path]) -> None:
        """Write the aggregates, and the description, figures and files of the sweep's run."""
        cells, every = findings.cells, [*findings.groups, *findings.confirmations]
        curves = mean_curves(findings.points, cells)
        for group in every:
            self.write_group(group, curves.get(group.id, NO_CURVE))
        for name, place in places(every).items():
            self._client.set_tag(self._known["aggregate", name].run_id, "place", place)
        self._nest(cells)
        self._client.set_tag(
            self.parent, "mlflow.note.content", markdown(self._results, findings.groups, findings.best)
        )
        self._log_sweep_metrics(sweep_metrics(findings.groups, findings.best))
        self._log_table(findings)
        for path in artifacts:
            folder = Path(path.parent.relative_to(self._results.folder).as_posix())
            with local_copy(path) as file:
                self._client.log_artifact(self.parent, str(file), None if folder == Path(".") else str(folder))
        planned = {("cell", cell_id) for cell_id in cells["cell_id"]} | {("aggregate", group.id) for group in every}
        for key in set(self._known) - planned - {("sweep", "")}:
            self._client.delete_run(self._known.pop(key).run_id)
        space, counts = self._meta["space"], findings.each_cell["status"].value_counts()
        tags = {f"cells_{status}": str(counts.get(status, 0)) for status in ("done", "failed", "stopped", "missing")}
        tags |= {"seeds": str(len(space["seeds"])), "agents": ", ".join(space["agents"])}
        tags |= {
            "targets": ", ".join(target for scenario in space["scenarios"] for target in scenario["targets"])[:5000]
        }
        self._client.log_batch(self.parent, tags=[RunTag(name, value) for name, value in tags.items()])
        self._client.set_terminated(self.parent)

    def _nest(self, cells: pd.DataFrame) -> None:
        """Nest every cell under the first of its aggregates, and name all of them in a tag."""
        for cell_id, of in cells.groupby("cell_id")["group"].agg(list).items() if len(cells) else ():
            key = "cell", str(cell_id)
            known, above, groups = self._known.get(key), self._known.get(("aggregate", of[0])), ", ".join(of)
            if known is None:
                continue
            if known.groups != groups:
                self._client.set_tag(known.run_id, "of_group", groups)
            if above is not None and known.parent != above.run_id:
                self._client.set_tag(known.run_id, PARENT, above.run_id)
                known = known._replace(parent=above.run_id)
            self._known[key] = known._replace(groups=groups)

    def _log_table(self, findings: Findings) -> None:
        """Write every configuration's numbers as MLflow's own kind of table; `log_table` would append to an old one."""
        if not findings.groups:
            return
        text = number_table(findings.groups).to_json(orient="split", index=False)
        self._client.log_text(self.parent, text, TABLE)
        self._client.set_tag(self.parent, LOGGED_TABLES, json.dumps([{"path": TABLE, "type": "table"}]))

    def _log_sweep_metrics(self, metrics: Mapping[str, float]) -> None:
        """Log the metrics of the sweep's run, except those that it has already."""
        there = self._client.get_run(self.parent).data.metrics
        stamp = int(time.time() * 1000)
        new = [Metric(name, value, stamp, 0) for name, value in metrics.items() if there.get(name) != value]
        if new:
            self._client.log_batch(self.parent, new)

    def end(self, status: str) -> None:
        """Set the status of a sweep that stopped early: KILLED by request, FAILED by an error."""
        self._client.set_terminated(self.parent, status)
        for (kind, _), known in self._known.items():
            if kind == "aggregate" and not known.whole:
                self._client.set_terminated(known.run_id, status)

    def _write(
        self,
        key: tuple[str, str],
        name: str,
        tags: Mapping[str, str],
        params: Mapping[str, Any],
        metrics: Mapping[str, float],
        curves: Mapping[str, Sequence[tuple[Any, Any]]],
        finished: float,
        seconds: float,
        status: str,
        above: str,
        inputs: Sequence[DatasetInput] = (),
    ) -> None:
        """Find or create the run of `key`, and fill it; its status is set last, and thereby marks it as complete."""
        known, digest = self._known.get(key), tags["digest"]
        if self._holds(key, digest):
            return
        if known is not None and known.digest not in (digest, None):
            self._client.delete_run(known.run_id)
            known = None
        begun = known is not None and known.digest is None
        known = (known or self._begin(key, name, tags, finished - seconds, above))._replace(digest=digest)
        stamp = int(finished * 1000)
        points = [Metric(metric, value, stamp, 0) for metric, value in metrics.items() if math.isfinite(value)]
        points += [
            Metric(metric, float(value), stamp, int(step))
            for metric, values in curves.items()
            for step, value in thinned(metric, [(s, v) for s, v in values if v is not None and math.isfinite(v)])
        ]
        texts = [Param(name, str(value)) for name, value in params.items()]
        late = [RunTag(each, value) for each, value in {**tags, "mlflow.runName": name}.items()] if begun else []
        batches = [points[start : start + BATCH] for start in range(0, max(len(points), 1), BATCH)]
        for number, batch in enumerate(batches):
            first = number == 0
            self._client.log_batch(known.run_id, batch, texts if first else (), late if first else ())
        if inputs:
            self._client.log_inputs(known.run_id, inputs)
        self._client.set_terminated(known.run_id, status, stamp)
        self._known[key] = known._replace(whole=True)

    def _begin(self, key: tuple[str, str], name: str, tags: Mapping[str, str], begun: float, above: str) -> _Known:
        """Create the run of `key`."""
        identity = {"kind": key[0], "sweep": self._results.name, "sweep_id": self._sweep_id}
        identity |= {"cell_id" if key[0] == "cell" else "group": key[1], PARENT: above}
        run = self._client.create_run(self._experiment, int(begun * 1000), {**tags, **identity}, name)
        known = _Known(str(run.info.run_id), tags.get("digest"), False, above, tags.get("of_group"))
        self._known[key] = known
        return known

    def _holds(self, key: tuple[str, str], digest: str) -> bool:
        known = self._known.get(key)
        return known is not None and known.whole and known.digest == digest

    def _runs(self) -> Iterable[Run]:
        token: str | None = None
        while True:
            page = self._client.search_runs(
                [self._experiment], f"tags.sweep_id = '{self._sweep_id}'", max_results=1000, page_token=token
            )
            yield from page
            token = page.token
            if not token:
                return

    def _key(self, tags: Mapping[str, str]) -> tuple[str, str]:
        kind = tags.get("kind", "")
        return kind, tags.get("cell_id" if kind == "cell" else "group", "")

    def _find_parent(self) -> str:
        known = self._known.get(("sweep", ""))
        if known is not None:
            self._client.update_run(known.run_id, status="RUNNING")
            return known.run_id
        tags = {"kind": "sweep", "sweep": self._results.name, "sweep_id": self._sweep_id}
        tags |= {"space": self._meta["space"]["name"], "commit": self._meta["commit"]}
        tags |= {f"version.{name}": version for name, version in self._meta["versions"].items()}
        run = self._client.create_run(self._experiment, int(self._meta["created"] * 1000), tags, self._results.name)
        return str(run.info.run_id)
