"""The runs of one sweep in an MLflow store: found by their tags, begun, filled, and put below each other.

A run is identified by its tags (`sweep_id` with `cell_id` or `group`), and its `digest` tag by its content; so writing
twice changes nothing. A run that was interrupted (its status is still RUNNING) is written again with the same time
stamps, which MLflow stores once.
"""

from __future__ import annotations

import logging
import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

from mlflow.entities import DatasetInput, Metric, Param, Run, RunTag
from mlflow.exceptions import MlflowException
from mlflow.tracking import MlflowClient

from orchestrator.tracking.mlflow.fields import thinned
from trainables.cell import content_id

log = logging.getLogger("deltatune.tracking")

PARENT = "mlflow.parentRunId"
"""The tag by which MLflow nests a run under another."""

BATCH = 800
"""Metrics per call, which may hold 1000 items; the first call has parameters and tags too."""

Key = tuple[str, str]
"""The kind of a run (sweep, aggregate, cell), and the id of its cell or group."""


def sweep_id(name: str, created: float) -> str:
    """Return the tag by which the runs of a sweep are found."""
    return content_id([name, created])


class Known(NamedTuple):
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
    place: str | None = None
    """The rank of a configuration."""


@dataclass(frozen=True)
class Content:
    """All that a run holds."""

    name: str
    tags: Mapping[str, str]
    """With `digest`."""
    params: Mapping[str, Any]
    metrics: Mapping[str, float]
    curves: Mapping[str, Sequence[tuple[Any, Any]]]
    """Metric to its (step, value) pairs."""
    finished: float
    """Seconds since 1970."""
    status: str
    above: str
    """The run under which it is nested."""
    seconds: float = 0.0
    inputs: Sequence[DatasetInput] = ()


class SweepRuns:
    """The runs of one sweep, by their keys."""

    def __init__(
        self, client: MlflowClient, experiment: str, identity: Mapping[str, str], check: Callable[[], None]
    ) -> None:
        """Find the runs with the tags `identity`, which has `sweep_id`. check: called before each request."""
        self._connected, self._experiment, self._identity, self._check = client, experiment, identity, check
        self.known = {
            _key(run.data.tags): Known(
                str(run.info.run_id),
                run.data.tags.get("digest"),
                _whole(run),
                run.data.tags.get(PARENT),
                run.data.tags.get("of_group"),
                run.data.tags.get("place"),
            )
            for run in self._found()
        }

    @property
    def client(self) -> MlflowClient:
        """The client for one request, which only the one who writes this sweep may make."""
        self._check()
        return self._connected

    def holds(self, key: Key, digest: str) -> bool:
        """Return whether the run of `key` is there, complete, with this content."""
        known = self.known.get(key)
        return known is not None and known.whole and known.digest == digest

    def write(self, key: Key, content: Content) -> None:
        """Find or create the run of `key`, and fill it; its status is set last, and thereby marks it as complete."""
        known, digest = self.known.get(key), content.tags["digest"]
        if self.holds(key, digest):
            return
        if known is not None and known.digest not in (digest, None):
            self.client.delete_run(known.run_id)
            known = None
        begun = known is not None and known.digest is None
        known = known or self.begin(key, content.name, content.tags, content.finished - content.seconds, content.above)
        known = known._replace(digest=digest, place=content.tags.get("place") if begun else known.place)
        late = {**content.tags, "mlflow.runName": content.name} if begun else {}
        self._fill(known.run_id, content, late)
        self.client.set_terminated(known.run_id, content.status, int(content.finished * 1000))
        self.known[key] = known._replace(whole=True)

    def _fill(self, run_id: str, content: Content, late: Mapping[str, str]) -> None:
        """Log the metrics, curves, parameters and inputs of a run. late: tags that it was begun without."""
        stamp = int(content.finished * 1000)
        points = [Metric(name, value, stamp, 0) for name, value in content.metrics.items() if math.isfinite(value)]
        points += [
            Metric(metric, float(value), stamp, int(step))
            for metric, values in content.curves.items()
            for step, value in thinned(metric, [(s, v) for s, v in values if v is not None and math.isfinite(v)])
        ]
        texts = [Param(name, str(value)) for name, value in content.params.items()]
        tags = [RunTag(name, value) for name, value in late.items()]
        for start in range(0, max(len(points), 1), BATCH):
            first = start == 0
            batch = points[start : start + BATCH]
            self.client.log_batch(run_id, batch, texts if first else (), tags if first else ())
        self._log_inputs(run_id, content.inputs)

    def _log_inputs(self, run_id: str, inputs: Sequence[DatasetInput]) -> None:
        """Log the inputs of a run, and again where another sweep has logged one of them at the same moment.

        MLflow looks whether the experiment has a dataset, and then adds it: the slower one of two gets an error, and
        finds the dataset there the next time.
        """
        for left in reversed(range(len(inputs) + 1 if inputs else 0)):
            try:
                self.client.log_inputs(run_id, inputs)
                return
            except MlflowException as error:
                if not left:
                    raise
                log.info("the inputs of run %s are logged again: %s", run_id, str(error).splitlines()[0])

    def begin(self, key: Key, name: str, tags: Mapping[str, str], begun: float, above: str | None) -> Known:
        """Create the run of `key`, under `above`."""
        kind, which = key
        identity = {"kind": kind, **self._identity}
        if above is not None:
            identity |= {"cell_id" if kind == "cell" else "group": which, PARENT: above}
        run = self.client.create_run(self._experiment, int(begun * 1000), {**tags, **identity}, name)
        known = Known(str(run.info.run_id), tags.get("digest"), False, above, tags.get("of_group"), tags.get("place"))
        self.known[key] = known
        return known

    def place(self, key: Key, place: str | None) -> None:
        """Give an aggregate's run its rank, unless it has it."""
        known = self.known[key]
        if place is not None and known.place != place:
            self.client.set_tag(known.run_id, "place", place)
            self.known[key] = known._replace(place=place)

    def nest(self, key: Key, groups: Sequence[str]) -> None:
        """Put a cell's run, if there is one, below the first of its aggregates, and name all of them in a tag."""
        known, above, names = self.known.get(key), self.known.get(("aggregate", groups[0])), ", ".join(groups)
        if known is None:
            return
        if known.groups != names:
            self.client.set_tag(known.run_id, "of_group", names)
        if above is not None and known.parent != above.run_id:
            self.client.set_tag(known.run_id, PARENT, above.run_id)
            known = known._replace(parent=above.run_id)
        self.known[key] = known._replace(groups=names)

    def keep(self, keys: Iterable[Key]) -> None:
        """Delete all other runs."""
        for key in set(self.known).difference(keys):
            self.client.delete_run(self.known.pop(key).run_id)

    def _found(self) -> Iterable[Run]:
        token: str | None = None
        condition = f"tags.sweep_id = '{self._identity['sweep_id']}'"
        while True:
            page = self.client.search_runs([self._experiment], condition, max_results=1000, page_token=token)
            yield from page
            token = page.token
            if not token:
                return


def _whole(run: Run) -> bool:
    """Return whether a run was written to its end. That of an aggregate is FINISHED, while a cell may have failed."""
    aggregate = run.data.tags.get("kind") == "aggregate"
    return bool(run.info.status == "FINISHED" if aggregate else run.info.status != "RUNNING")


def _key(tags: Mapping[str, str]) -> Key:
    kind = tags.get("kind", "")
    return kind, tags.get("cell_id" if kind == "cell" else "group", "")
