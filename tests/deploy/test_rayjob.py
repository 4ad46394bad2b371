"""The RayJob has the fields that KubeRay knows, runs a command that exists, and meets Kubernetes' strictest profile."""

from __future__ import annotations

import copy
import re
import shlex
from collections.abc import Callable
from pathlib import Path
from typing import Any

import jsonschema
import pytest
import typer.main
import yaml

from deltatune.cli.main import app

ROOT = Path(__file__).parents[2]
SCHEMA = yaml.safe_load((Path(__file__).parent / "rayjob_schema.yaml").read_text())
JOB = yaml.safe_load((ROOT / "deploy/rayjob.yaml").read_text())
CLUSTER = JOB["spec"]["rayClusterSpec"]
HEAD, WORKERS = CLUSTER["headGroupSpec"], CLUSTER["workerGroupSpecs"][0]
PODS = [group["template"]["spec"] for group in (HEAD, WORKERS)]

Change = Callable[[dict[str, Any]], object]


def test_the_manifest_is_of_the_schema() -> None:
    jsonschema.Draft7Validator.check_schema(SCHEMA)
    jsonschema.validate(JOB, SCHEMA)


@pytest.mark.parametrize(
    "change",
    [
        lambda job: job.update(apiVersion="ray.io/v1alpha1"),
        lambda job: job["spec"].update(shutDownAfterJobFinishes=True),
        lambda job: job["spec"].update(submissionMode="HttpMode"),
        lambda job: job["spec"]["rayClusterSpec"]["headGroupSpec"]["rayStartParams"].update({"num-cpus": 0}),
        lambda job: job["spec"]["rayClusterSpec"]["workerGroupSpecs"][0].pop("groupName"),
        lambda job: job["spec"]["rayClusterSpec"]["workerGroupSpecs"][0]["template"]["spec"].pop("containers"),
        lambda job: job["spec"]["rayClusterSpec"]["headGroupSpec"]["template"]["spec"]["containers"][0].pop("image"),
    ],
)
def test_the_schema_finds_a_mistake(change: Change) -> None:
    job = copy.deepcopy(JOB)
    change(job)
    with pytest.raises(jsonschema.ValidationError):
        jsonschema.validate(job, SCHEMA)


def test_the_entrypoint_is_a_command_with_options_that_exist() -> None:
    program, name, *rest = shlex.split(JOB["spec"]["entrypoint"])
    command = typer.main.get_command(app).commands[name]  # type: ignore[attr-defined]
    known = {option for parameter in command.params for option in parameter.opts}
    assert program == "deltatune"
    assert {word for word in rest if word.startswith("-")} <= known
    assert rest[rest.index("--address") + 1] == "auto"
    assert "://" in rest[rest.index("--storage") + 1], "a folder of the head is gone with the pod"


@pytest.mark.parametrize("pod", PODS, ids=["head", "worker"])
def test_a_pod_meets_the_restricted_profile(pod: dict[str, Any]) -> None:
    assert pod["securityContext"]["runAsNonRoot"]
    assert pod["securityContext"]["runAsUser"] > 0
    assert pod["securityContext"]["seccompProfile"] == {"type": "RuntimeDefault"}
    assert pod["automountServiceAccountToken"] is False
    for container in pod["containers"]:
        assert container["securityContext"]["allowPrivilegeEscalation"] is False
        assert container["securityContext"]["capabilities"] == {"drop": ["ALL"]}
        assert container["resources"]["requests"] == container["resources"]["limits"], "Ray counts the limits"


def test_the_user_is_that_of_the_image() -> None:
    user = re.findall(r"^USER (\d+):(\d+)$", (ROOT / "deploy/Dockerfile").read_text(), re.MULTILINE)[-1]
    for pod in PODS:
        assert (str(pod["securityContext"]["runAsUser"]), str(pod["securityContext"]["runAsGroup"])) == user


def test_credentials_come_from_secrets_alone() -> None:
    assert not [container for pod in PODS for container in pod["containers"] if "env" in container]
    head, worker = (
        [source["secretRef"]["name"] for container in pod["containers"] for source in container["envFrom"]]
        for pod in PODS
    )
    assert head == ["deltatune-storage", "deltatune-mlflow"]
    assert worker == ["deltatune-storage"], "workers write nothing to MLflow"


def test_the_cluster_is_protected_fixed_in_size_and_taken_down() -> None:
    assert CLUSTER["authOptions"] == {"mode": "token"}
    assert HEAD["serviceType"] == "ClusterIP"
    assert HEAD["rayStartParams"]["num-cpus"] == "0", "cells on the head can take the driver with them"
    assert WORKERS["replicas"] == WORKERS["minReplicas"] == WORKERS["maxReplicas"] > 0
    assert JOB["spec"]["shutdownAfterJobFinishes"]
    assert JOB["spec"]["backoffLimit"] > 0
