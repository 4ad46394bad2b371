"""A sweep for other programs: what `deltatune export --format` writes."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from orchestrator.analysis.findings import Findings
from orchestrator.export.best_params import best, write_best
from orchestrator.export.latex import table_1
from orchestrator.export.sb3 import dqn_arguments
from trainables.errors import InputError, unknown
from trainables.storage.atomic import write_atomic
from trainables.storage.folders import make_folder


@dataclass(frozen=True)
class Written:
    """What an export wrote."""

    what: str
    files: tuple[Path, ...]
    data: dict[str, Any]
    """The same for a program; of tables, the names of the files."""


def write(findings: Findings, form: str, output: Path | None = None) -> Written:
    """Write `findings` as `form`, one of FORMATS, to `output`, or to the format's own name in the working folder.

    Raises InputError where the form is unknown, the place cannot be written to, or the sweep has nothing of the kind.
    """
    if form not in FORMATS:
        raise unknown("format", form, FORMATS)
    name, writer = FORMATS[form]
    return writer(findings, output or Path(name or findings.results.name))


def _yaml(findings: Findings, path: Path) -> Written:
    data = write_best(findings, path)
    return Written(f"{len(data['best'])} best configurations", (path,), data)


def _json(findings: Findings, path: Path) -> Written:
    data = best(findings)
    return _data(findings, path, data, len(data["best"]), "best configurations")


def _sb3(findings: Findings, path: Path) -> Written:
    data = dqn_arguments(findings)
    if findings.best and not data["dqn"]:
        raise InputError(f"the sweep '{findings.results.name}' has no deep agent: DQN has no counterpart of the others")
    return _data(findings, path, data, len(data["dqn"]), "sets of keyword arguments for stable-baselines3's DQN")


def _data(findings: Findings, path: Path, data: dict[str, Any], number: int, what: str) -> Written:
    _check(findings)
    text = json.dumps(data, indent=2, ensure_ascii=False, allow_nan=False) + "\n"
    return Written(f"{number} {what}", (_put(path, text),), data)


def _latex(findings: Findings, path: Path) -> Written:
    _check(findings)
    return Written("Table 1", (_put(path, table_1(findings)),), {"files": [str(path)]})


def _csv(findings: Findings, folder: Path) -> Written:
    return _tables(findings, folder, "csv", lambda table, path: table.to_csv(path, index=False))


def _parquet(findings: Findings, folder: Path) -> Written:
    return _tables(findings, folder, "parquet", lambda table, path: table.to_parquet(path, index=False))


def _tables(findings: Findings, folder: Path, ending: str, write_table: Callable[[Any, Path], Any]) -> Written:
    make_folder(folder)
    files = []
    for name, table in (("cells", findings.cells), ("points", findings.points)):
        write_table(table, folder / f".{name}.{ending}")
        files.append((folder / f".{name}.{ending}").replace(folder / f"{name}.{ending}"))
    what = f"{len(findings.each_cell)} cells, {len(findings.points)} points"
    return Written(what, tuple(files), {"files": [str(path) for path in files]})


def _check(findings: Findings) -> None:
    if not findings.best:
        name = findings.results.name
        raise InputError(f"the sweep '{name}' has no configuration whose every seed is done: run it first")


def _put(path: Path, text: str) -> Path:
    make_folder(path.absolute().parent)
    write_atomic(path.absolute(), text.encode())
    return path


FORMATS: dict[str, tuple[str, Callable[[Findings, Path], Written]]] = {
    "yaml": ("best.yaml", _yaml),
    "json": ("best.json", _json),
    "sb3": ("best-sb3.json", _sb3),
    "csv": ("", _csv),
    "parquet": ("", _parquet),
    "latex": ("table1.tex", _latex),
}
"""Format to the name of its file (empty: a folder named after the sweep) and its writer."""
