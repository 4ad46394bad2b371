"""The commands that reproduce a sweep and its report."""

from __future__ import annotations

import shlex

import yaml

from orchestrator.analysis.findings import Findings
from orchestrator.analysis.groups import Group
from search_spaces.loading import built_in, load


def command(findings: Findings, group: Group) -> str:
    """Return the command that trains a best configuration again."""
    words = ["deltatune", "sweep", space_argument(findings), "--tasks", group.task, "--agents", group.agent]
    return shlex.join([*words, "--params", "best.yaml", "--name", f"{findings.results.name[:59]}-best"])


def export_command(findings: Findings) -> str:
    """Return the command that writes the best hyperparameters to best.yaml."""
    return shlex.join(["deltatune", "export", findings.results.name, "-o", "best.yaml"])


def space_argument(findings: Findings) -> str:
    """Return the name of the built-in search space, if the sweep ran it unchanged, else the file in the report."""
    space = findings.results.space()
    return space.name if space.name in built_in() and load(space.name) == space else "space.yaml"


def space_yaml(findings: Findings) -> str:
    """Return the search space as the YAML that `deltatune sweep` reads."""
    return yaml.safe_dump(findings.results.space().to_json(), sort_keys=False, allow_unicode=True, width=110)
