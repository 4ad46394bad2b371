"""The MLflow experiment that a family of sweeps shares."""

from __future__ import annotations

from pathlib import Path

from mlflow.tracking import MlflowClient

from orchestrator.tracking.mlflow.views import VIEWS
from trainables.cell import content_id

FAMILY = "deltatune/"
"""What the names of our experiments begin with."""

_TAGS = {"mlflow.experimentKind": "custom_model_development"}
"""Opens the experiment in the UI's view for training runs."""


def find_experiment(client: MlflowClient, uri: str, family: str, artifacts: Path) -> str:
    """The id of a family's experiment, made where missing; that of a local store keeps its files under `artifacts`."""
    name, views = f"{FAMILY}{family}", dict(view.tag() for view in VIEWS)
    found = client.get_experiment_by_name(name)
    if found is None:
        location = None
        if uri.startswith("sqlite:"):
            location = (artifacts / content_id(name)).as_uri()
        return str(client.create_experiment(name, location, _TAGS | views))
    for key, value in views.items():  # an older version's experiment is brought up to this one's views
        if found.tags.get(key) != value:
            client.set_experiment_tag(found.experiment_id, key, value)
    return str(found.experiment_id)
