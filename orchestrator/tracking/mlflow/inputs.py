"""What a run in MLflow was made from: its tasks as datasets, and the sources that it used as logged models."""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping

from mlflow.entities import Dataset, DatasetInput, InputTag, LoggedModelInput
from mlflow.tracking import MlflowClient

from orchestrator.analysis.groups import Group
from orchestrator.results.sweep_folder import Results
from orchestrator.tracking.configurations import Configurations
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


def link_sources(client: MlflowClient, results: Results, sweep: tuple[str, str], models: Mapping[str, str]) -> None:
    """Link every source model to the aggregates whose cells used it; MLflow keeps each link once.

    sweep: the ids of the experiment and of the sweep. models: a source's cell to its logged model.
    """
    experiment, sweep_id = sweep
    configurations, used = Configurations(results), dict[str, set[str]]()
    for cell in results.plan().get("transfer", ()):
        ids = {models[str(source.cell_id)] for source in cell.sources if source.cell_id in models}
        for group in configurations.of("transfer", cell):
            used.setdefault(group, set()).update(ids)
    condition = f"tags.kind = 'aggregate' and tags.sweep_id = '{sweep_id}'"
    token: str | None = None
    while True:
        page = client.search_runs([experiment], condition, max_results=1000, page_token=token)
        for run in page:
            _link(client, str(run.info.run_id), used.get(run.data.tags.get("group", ""), ()))
        token = page.token
        if not token:
            return


def _link(client: MlflowClient, run: str, models: Iterable[str]) -> None:
    wanted = [LoggedModelInput(model) for model in sorted(models)]
    if wanted:
        client.log_inputs(run, models=wanted)
