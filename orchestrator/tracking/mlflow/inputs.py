"""The tasks of a run in MLflow, as datasets."""

from __future__ import annotations

import json

from mlflow.entities import Dataset, DatasetInput, InputTag

from orchestrator.analysis.groups import Group
from trainables.cell import content_id
from trainables.tasks.registry import parse_task

TABLE = "results.json"
"""The table of results in the sweep's run, as `mlflow.load_table` reads it."""

_ROLE = "mlflow.data.context"
"""The tag of a dataset's role in a run."""


def tasks_of(group: Group) -> list[DatasetInput]:
    """Return the target task and the source task of a configuration, with their context features."""
    target = [dataset(group.task, "target" if group.stage == "transfer" else "source")]
    return target + ([dataset(group.source_task, "source")] if group.source_task and group.source != "none" else [])


def dataset(task: str, role: str) -> DatasetInput:
    """Return a task as a dataset: its context features are the schema, their values the profile."""
    context = {name: _plain(value) for name, value in parse_task(task).context.items()}
    columns = [{"name": name, "type": _type(value), "required": True} for name, value in context.items()]
    entity = Dataset(
        task[:500],
        content_id([task, context]),
        "deltatune",
        json.dumps({"task": task}),
        json.dumps({"mlflow_colspec": columns}),
        json.dumps(context),
    )
    return DatasetInput(entity, [InputTag(_ROLE, role)])


def _plain(value: object) -> object:
    return value if isinstance(value, bool | int | float | str) else str(value)


def _type(value: object) -> str:
    return "double" if isinstance(value, int | float) and not isinstance(value, bool) else "string"
