"""Source knowledge in MLflow's Model Registry: a registered model per source task, a version per source model.

A version holds the source's .npz and `pyfunc_policy.py`; its tags describe it (`SourceModel.tags`). The alias `best`
points to the best version by `source_models.standing`. A version is identified by its cell and digest, so registering
twice changes nothing.
"""

from __future__ import annotations

import json
import re
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from mlflow.artifacts import download_artifacts
from mlflow.entities import LoggedModelOutput, Run
from mlflow.entities.model_registry import ModelVersion
from mlflow.exceptions import MlflowException
from mlflow.tracking import MlflowClient

from orchestrator.analysis.curves.learning import learned_nothing
from orchestrator.analysis.labels import cell_name, settings_text, varied
from orchestrator.errors import SweepError
from orchestrator.model_registry.source_models import (
    SourceModel,
    logged_name,
    model_name,
    read_steps,
    source_models,
    standing,
    steps_text,
)
from orchestrator.results.sweep_folder import Results
from orchestrator.tracking.mlflow.inputs import link_sources
from orchestrator.tracking.mlflow.store import connect
from orchestrator.tracking.uri import shown
from trainables.errors import InputError
from trainables.tasks.registry import parse_task

ALIAS = "best"
KNOWLEDGE = "source.npz"
"""The artifact with a version's knowledge."""

VERSIONS = "mlflow.modelVersions"
"""The tag by which the page of a logged model leads to its registered versions; a server sets it itself."""

REQUIREMENTS = ["mlflow>=3.13", "numpy>=1.26"]
"""The packages that loading a version needs."""

SCANNED = "_MODULES_TO_PACKAGES"
"""Where MLflow keeps the packages of all modules once it has looked for them, which takes a second."""

_CODE = Path(__file__).with_name("pyfunc_policy.py")


@dataclass(frozen=True)
class Fetched:
    """A version that was downloaded."""

    uri: str
    """models:/NAME/VERSION."""
    data: bytes
    """The .npz."""
    tags: Mapping[str, str]


def register(results: Results, uri: str, parent: str) -> list[str]:
    """Register the source models of a sweep, link them to the runs that used them, and set models:/NAME@best.

    Return these names, with a remark where even the best version learned nothing. parent: the sweep's run, the parent
    of the source models' runs. Raises MlflowException and OSError.
    """
    found = source_models(results)
    if not found:
        return []
    client = connect(uri)
    below = client.get_run(parent)
    names = list(dict.fromkeys(model_name(model.cell.task) for model in found))
    remarks, linked = {}, dict[str, str]()
    for name in names:
        models = [model for model in found if model_name(model.cell.task) == name]
        known = _model(client, name, models[0].cell.task)
        for model in models:
            key = model.cell.id, model.knowledge.digest
            version = known.get(key)
            if version is None:
                known[key] = _write(client, name, model, below)
            else:
                _add_steps(client, version, model)
        linked |= {cell: at for (cell, _), version in known.items() if (at := _logged_model(version))}
        best = _point(client, name, list(known.values()))
        remarks[name] = f" ({best.tags['learned']})" if "learned" in best.tags else ""
    link_sources(client, results, (str(below.info.experiment_id), below.data.tags["sweep_id"]), linked)
    return [f"models:/{name}@{ALIAS}{remarks[name]}" for name in names]


def register_now(results: Results, uri: str, parent: str) -> list[str]:
    """Do the same as `register`, but raise SweepError where the store does not answer."""
    try:
        return register(results, uri, parent)
    except (MlflowException, OSError) as error:
        raise SweepError(f"the registry of {shown(uri)} cannot be written to: {str(error).splitlines()[0]}") from None


def fetch(text: str, uri: str) -> Fetched:
    """Return the version that models:/NAME@ALIAS or models:/NAME/VERSION names. No code in it is run.

    Raises InputError where there is none, deltatune did not write it, or MLflow does not answer.
    """
    name, at, alias = text.removeprefix("models:/").partition("@")
    name, _, number = (name, "", "") if at else name.partition("/")
    if not name or not (alias if at else number.isdigit()):
        raise InputError(f"a registered source is models:/NAME@ALIAS or models:/NAME/VERSION (got '{text}')")
    try:
        client = connect(uri)
        version = client.get_model_version_by_alias(name, alias) if at else client.get_model_version(name, number)
        where = f"{client.get_model_version_download_uri(name, version.version)}/artifacts/{KNOWLEDGE}"
        with tempfile.TemporaryDirectory(prefix="deltatune-") as folder:
            path = download_artifacts(where, dst_path=folder, tracking_uri=uri)
            return Fetched(f"models:/{name}/{version.version}", Path(path).read_bytes(), dict(version.tags))
    except (MlflowException, OSError) as error:
        raise InputError(f"'{text}' cannot be had from MLflow at {shown(uri)}: {str(error).splitlines()[0]}") from None


def _model(client: MlflowClient, name: str, task: str) -> dict[tuple[str, str], ModelVersion]:
    """Return the versions of a registered model by cell and digest; create the model where it is missing."""
    there = client.search_model_versions(f"name = '{name}'")
    versions = {(v.tags["cell_id"], v.tags["digest"]): v for v in there if {"cell_id", "digest"} <= set(v.tags)}
    if not versions:
        try:
            client.create_registered_model(name, {"task": task, "kind": "source"}, _model_text(name, task))
        except MlflowException as error:
            if error.error_code != "RESOURCE_ALREADY_EXISTS":
                raise
    return versions


def _write(client: MlflowClient, name: str, model: SourceModel, parent: Run) -> ModelVersion:
    """Create a version and its logged model, both linked to the run of the model's cell."""
    tags, experiment = model.tags(parent.data.tags["sweep"]), str(parent.info.experiment_id)
    condition = f"tags.cell_id = '{model.cell.id}' and tags.sweep_id = '{parent.data.tags['sweep_id']}'"
    runs = client.search_runs([experiment], condition, max_results=1)
    run = str((runs[0] if runs else parent).info.run_id)
    logged = client.create_logged_model(experiment, logged_name(name), run, tags, model_type="source")
    with tempfile.TemporaryDirectory(prefix="deltatune-") as folder:
        client.log_model_artifacts(logged.model_id, str(_save(Path(folder), model, logged.model_id, run)))
    client.finalize_logged_model(logged.model_id, "READY")
    client.log_outputs(run, [LoggedModelOutput(logged.model_id, 0)])
    text = _version_text(name, model)
    where = logged.artifact_location
    version = client.create_model_version(name, where, run, tags, None, text, model_id=logged.model_id)
    there = [{"name": name, "version": str(version.version)}]
    client.set_logged_model_tags(logged.model_id, {VERSIONS: json.dumps(there)})
    return version


def _logged_model(version: ModelVersion) -> str | None:
    """Return the id of a version's logged model, from where its files are: a store of SQL does not keep it."""
    found = re.search(r"/models/(m-[0-9a-f]+)/", f"{version.source}/")
    return version.model_id or (found[1] if found else None)


def _save(folder: Path, model: SourceModel, model_id: str, run: str) -> Path:
    """Write the model's files to a folder below `folder`, and return it."""
    from mlflow import pyfunc
    from mlflow.models import Model, ModelSignature
    from mlflow.types import ColSpec, Schema, TensorSpec

    knowledge = folder / KNOWLEDGE
    knowledge.write_bytes(model.knowledge.to_bytes({"cell": model.cell.to_json()}))
    actions = Schema([TensorSpec(np.dtype(np.int64), (-1,))])
    example: Any
    if parse_task(model.cell.task).tabular:
        example, inputs = np.arange(2), Schema([TensorSpec(np.dtype(np.int64), (-1,))])
    else:
        size = int(model.knowledge.arrays["sizes"][0])
        example, inputs = np.zeros((2, size), np.float32), Schema([ColSpec("double") for _ in range(size)])
    with _no_scan():
        pyfunc.save_model(
            folder / "model",
            python_model=str(_CODE),
            artifacts={"knowledge": str(knowledge)},
            signature=ModelSignature(inputs, actions),
            input_example=example,
            pip_requirements=REQUIREMENTS,
            mlflow_model=Model(model_id=model_id, run_id=run),
        )
    return folder / "model"


@contextmanager
def _no_scan() -> Iterator[None]:
    """Keep MLflow from listing each file of each installed package, only to look up two that it knows by name."""
    from mlflow.utils import requirements_utils

    before = getattr(requirements_utils, SCANNED, None)
    setattr(requirements_utils, SCANNED, before or {"mlflow": ["mlflow"], "numpy": ["numpy"]})
    try:
        yield
    finally:
        setattr(requirements_utils, SCANNED, before)


def _add_steps(client: MlflowClient, version: ModelVersion, model: SourceModel) -> None:
    """Add the steps of seeds that the sweep has finished since."""
    before = version.tags.get("steps", "{}")
    after = steps_text({**read_steps(before), **model.steps})
    if after != before:
        client.set_model_version_tag(version.name, str(version.version), "steps", after)


def _point(client: MlflowClient, name: str, versions: Sequence[ModelVersion]) -> ModelVersion:
    """Set the alias on the best version, the oldest of equal ones, and return it."""
    oldest_first = sorted(versions, key=lambda version: int(version.version))
    best = max(oldest_first, key=lambda version: standing(version.tags))
    if client.get_registered_model(name).aliases.get(ALIAS) != str(best.version):
        client.set_registered_model_alias(name, ALIAS, str(best.version))
    return best


def _model_text(name: str, task: str) -> str:
    """Return the description of a registered model."""
    takes = "states (B,), int64" if parse_task(task).tabular else "observations (B, obs_dim), an array or a DataFrame"
    return f"""Source knowledge of the task `{task}`. The alias `{ALIAS}` is on the version with the best
{"AUC" if parse_task(task).tabular else "greedy evaluation, and of equals the best AUC"}.

Greedy actions (B,) for {takes}; the model needs numpy and MLflow alone:

```python
mlflow.pyfunc.load_model("models:/{name}@{ALIAS}").predict(observations)
```

As the source of a sweep, in place of its first stage: `deltatune sweep SPACE --source models:/{name}@{ALIAS}`
"""


def _version_text(name: str, model: SourceModel) -> str:
    """Return the description of a version."""
    cell, returns = model.cell, model.record.returns
    nothing = learned_nothing(returns)
    return (f"It {nothing}. " if nothing else "") + (
        f"{cell_name(cell)}: {settings_text(varied(cell.agent, cell.task, cell.hyperparameters))}; "
        f"best greedy evaluation {max(returns):.2f}, last {returns[-1]:.2f}. Cell `{cell.id}`."
    )
