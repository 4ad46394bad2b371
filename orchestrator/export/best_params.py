"""Writes the best hyperparameters as YAML that a later sweep accepts, and reads such a file."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import Any

import yaml

from orchestrator.analysis.contrasts.table import numbers as contrast_numbers
from orchestrator.analysis.findings import Findings
from orchestrator.analysis.groups import Group
from orchestrator.analysis.metrics import shown
from orchestrator.analysis.selection import RULE, Selected, optimism
from orchestrator.analysis.statistics import LEVEL, Estimate, TransferRatio
from orchestrator.planning.arms import Key, Params
from orchestrator.results.provenance import commit, versions
from search_spaces.safe_yaml import read_yaml
from trainables.agents.registry import agent_named
from trainables.errors import InputError
from trainables.storage.atomic import write_atomic
from trainables.storage.folders import make_folder
from trainables.tasks.registry import parse_task

SCHEMA = 1


def best(findings: Findings) -> dict[str, Any]:
    """Return the best hyperparameters of each arm, as plain data."""
    cells, selected = findings.each_cell, findings.selected
    wanted = dict.fromkeys(group.key for group in findings.groups)
    return {
        "schema": SCHEMA,
        "sweep": findings.results.name,
        "rule": RULE,
        "note": optimism(findings.best),
        "interval": f"{LEVEL:.0%}: Student's t for means and differences, Fieller for transfer ratios",
        "commit": commit(),
        "versions": versions(),
        "cells": {str(key): int(n) for key, n in cells["status"].value_counts().items()} if len(cells) else {},
        "best": [_entry(selected[key]) for key in wanted if key in selected],
        "contrasts": [contrast_numbers(contrast) for contrast in findings.contrasts],
        "without_complete_configuration": [_incomplete(key) for key in wanted if key not in selected],
    }


def write_best(findings: Findings, path: Path) -> dict[str, Any]:
    """Write `best` as YAML to `path`. Raises InputError where it cannot be written, or nothing is complete yet."""
    data = best(findings)
    if not data["best"]:
        name = findings.results.name
        raise InputError(f"the sweep '{name}' has no configuration whose every seed is done: run it first")
    make_folder(path.absolute().parent)
    head = f"# {data['note']}\n" if data["note"] else ""
    text = head + yaml.safe_dump(data, sort_keys=False, allow_unicode=True, width=120)
    write_atomic(path.absolute(), text.encode())
    return data


def read_params(path: Path) -> Params:
    """Return the hyperparameters in a file that `write_best` wrote, by arm. Raises InputError for another file."""
    data = read_yaml(path)
    if not isinstance(data, dict) or data.get("schema") != SCHEMA or not isinstance(data.get("best"), list):
        raise InputError(f"{path}: not a file of best hyperparameters (schema {SCHEMA}, written by 'deltatune export')")
    params: dict[Key, dict[str, Any]] = {}
    for number, entry in enumerate(data["best"]):
        try:
            task, agent = parse_task(entry["task"]), agent_named(entry["agent"])
            values = agent.resolve(task, entry["hyperparameters"]).model_dump()
            rest = (str(entry.get(name) or "") for name in ("source_task", "pick"))
            params[_key(task.name, agent.name, str(entry["source"]), *rest)] = values
        except (KeyError, TypeError, AttributeError) as error:
            raise InputError(
                f"{path}: best.{number} lacks a task, agent, source or hyperparameters ({error})"
            ) from None
        except InputError as error:
            raise InputError(f"{path}: best.{number}: {error}") from None
    return params


def _key(task: str, agent: str, kind: str, source_task: str, pick: str) -> Key:
    return Key(task, agent, parse_task(source_task).name if source_task else "", kind, pick)


def _incomplete(key: Key) -> list[str]:
    """Return the entry of an arm without a complete configuration: task, agent, kind of source, source task, pick."""
    return [key.task, key.agent, key.kind, key.source_task, key.pick]


def arm_entry(group: Group) -> dict[str, Any]:
    """Return the arm of a configuration as plain data: task, agent, source, source task, pick."""
    return {
        "task": group.task,
        "agent": group.agent,
        "source": group.source,
        "source_task": group.source_task,
        "pick": group.pick or None,
    }


def _entry(selected: Selected) -> dict[str, Any]:
    group = selected.best
    return {
        **arm_entry(group),
        "hyperparameters": dict(group.hyperparameters),
        **{metric.key: _estimate(group.estimates.get(metric.key)) for metric in shown("best")},
        "seeds": list(group.seeds),
        **({"source_networks": group.networks} if group.networks > 1 else {}),
        **({"confirmed": _confirmed(group.confirmed)} if group.confirmed else {}),
        "configurations": selected.tried,
        "configurations_left_out": selected.left_out,
        "ties": [dict(tie.hyperparameters) for tie in selected.ties],
    }


def _confirmed(found: Group) -> dict[str, Any]:
    """Return what the unseen seeds say of a configuration."""
    return {
        **{metric.key: _estimate(found.estimates.get(metric.key)) for metric in shown("best")},
        "verdict": found.verdict,
        "seeds": list(found.seeds),
    }


def _estimate(estimate: Estimate | TransferRatio | None) -> dict[str, Any] | None:
    return None if estimate is None else {key: value for key, value in asdict(estimate).items() if value is not None}
