"""The writers behind the formats of `deltatune export`."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pandas as pd

from orchestrator.analysis.contrasts.table import number_table as contrast_table
from orchestrator.analysis.findings import Findings
from orchestrator.analysis.over_tasks import number_table as standings_table
from orchestrator.analysis.tables.summary_table import number_table
from orchestrator.export.best_params import best, write_best
from orchestrator.export.formats import Written
from orchestrator.export.latex import table_1
from orchestrator.export.sb3 import dqn_arguments
from trainables.errors import InputError
from trainables.storage.atomic import write_atomic
from trainables.storage.folders import make_folder


def write_yaml(findings: Findings, path: Path) -> Written:
    """Write best.yaml."""
    data = write_best(findings, path)
    return Written(f"{len(data['best'])} best configurations", (path,), data)


def write_json(findings: Findings, path: Path) -> Written:
    """Write the same as JSON."""
    data = best(findings)
    return _data(findings, path, data, len(data["best"]), "best configurations")


def write_sb3(findings: Findings, path: Path) -> Written:
    """Write the best configurations of deep agents as keyword arguments of stable-baselines3's DQN."""
    data = dqn_arguments(findings)
    if findings.best and not data["dqn"]:
        raise InputError(f"the sweep '{findings.results.name}' has no deep agent: DQN has no counterpart of the others")
    return _data(findings, path, data, len(data["dqn"]), "sets of keyword arguments for stable-baselines3's DQN")


def _data(findings: Findings, path: Path, data: dict[str, Any], number: int, what: str) -> Written:
    _check(findings)
    text = json.dumps(data, indent=2, ensure_ascii=False, allow_nan=False) + "\n"
    return Written(f"{number} {what}", (_put(path, text),), data)


def write_latex(findings: Findings, path: Path) -> Written:
    """Write the table of the report."""
    _check(findings)
    return Written("Table 1", (_put(path, table_1(findings)),), {"files": [str(path)]})


def write_csv(findings: Findings, folder: Path) -> Written:
    """Write the tables as CSV."""
    return _tables(findings, folder, "csv", lambda table, path: table.to_csv(path, index=False))


def write_parquet(findings: Findings, folder: Path) -> Written:
    """Write the tables as Parquet."""
    return _tables(findings, folder, "parquet", lambda table, path: table.to_parquet(path, index=False))


def _tables(findings: Findings, path: Path, ending: str, write_table: Callable[[pd.DataFrame, Path], Any]) -> Written:
    """Write every table into the folder `path`, or the configurations alone where it names a file."""
    tables = {"configurations": number_table(findings.groups), "contrasts": contrast_table(findings.contrasts)}
    if findings.over_tasks.standings:
        tables["over_tasks"] = standings_table(findings.over_tasks)
    tables |= {"cells": findings.cells, "points": findings.points}
    what = f"{len(findings.groups)} configurations, {len(findings.each_cell)} cells, {len(findings.points)} points"
    if path.suffix in (".csv", ".parquet"):
        if path.suffix != f".{ending}":
            raise InputError(f"{path} is the name of a {path.suffix[1:]} file: give --format {path.suffix[1:]}")
        folder, names = make_folder(path.absolute().parent), {"configurations": path.name}
        what = f"{len(findings.groups)} configurations"
    else:
        folder, names = make_folder(path), {name: f"{name}.{ending}" for name in tables}
    files = []
    for name, file in names.items():
        write_table(tables[name], folder / f".{file}")
        files.append((folder / f".{file}").replace(folder / file))
    return Written(what, tuple(files), {"files": [str(path) for path in files]})


def _check(findings: Findings) -> None:
    if not findings.best:
        name = findings.results.name
        raise InputError(f"the sweep '{name}' has no configuration whose every seed is done: run it first")


def _put(path: Path, text: str) -> Path:
    make_folder(path.absolute().parent)
    write_atomic(path.absolute(), text.encode())
    return path
