"""The MLflow experiment of a family of sweeps."""

from __future__ import annotations

from pathlib import Path

from mlflow.tracking import MlflowClient

from orchestrator.tracking.mlflow.views import VIEWS
from trainables.cell import content_id

FAMILY = "deltatune/"
"""Prefix of the names of deltatune's experiments."""

_TAGS = {"mlflow.experimentKind": "custom_model_development"}
"""Makes the UI open the experiment in its view for training runs."""


def find_experiment(client: MlflowClient, uri: str, family: str, artifacts: Path) -> str:
    """Return the id of a family's experiment, created where missing; a local store keeps its files in `artifacts`."""
    name, views = f"{FAMILY}{family}", dict(view.tag() for view in VIEWS)
    found = client.get_experiment_by_name(name)
    if found is None:
        location = None
        if uri.startswith("sqlite:"):
            location = (artifacts / content_id(name)).as_uri()
        return str(client.create_experiment(name, location, _TAGS | views))
    for key, value in views.items():  # updates the views of an experiment from an older version
        if found.tags.get(key) != value:
            client.set_experiment_tag(found.experiment_id, key, value)
    return str(found.experiment_id)
