"""Pretrained sources passed with `--source`: versions in MLflow's registry, or files of a source library."""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from orchestrator.model_registry.source_models import read_steps
from orchestrator.planning.source_choice import Runs, SourceRun
from orchestrator.results import pretrained_names
from orchestrator.results.sweep_folder import Results
from orchestrator.sources.library import SourceLibrary
from orchestrator.tracking.trackers import without_registry
from search_spaces.search_space import SearchSpace
from trainables.cell import Cell
from trainables.errors import InputError
from trainables.knowledge import Knowledge
from trainables.tasks.registry import parse_task
from trainables.tasks.spec.family import Task


@dataclass(frozen=True)
class Pretrained:
    """A pretrained source that was checked."""

    name: str
    """models:/NAME/VERSION, or the file."""
    cell: Cell
    """The cell that trained it."""
    knowledge: Knowledge
    best_return: float
    auc: float
    """-inf where it is unknown."""
    steps: Mapping[int, int]
    """Seed to T, the training steps of that seed's source run; other seeds get the T of this source."""

    def run(self, seed: int) -> SourceRun:
        """Return the source run for a target cell of this seed."""
        default = int(self.knowledge.arrays.get("steps", 0))
        return SourceRun(self.cell, self.best_return, self.auc, self.steps.get(seed, default))


def read(names: Sequence[str], space: SearchSpace, uri: str) -> list[Pretrained]:
    """Return the sources called `names`: models:/NAME@ALIAS, models:/NAME/VERSION, or a file of a source library.

    uri: the MLflow store of the first two. Raises InputError for a source that is missing or damaged, does not fit its
    task, or belongs to no scenario of the space; and for two sources of one task that cannot be combined.
    """
    found = [read_one(name, uri) for name in names]
    learned = [scenario.source for scenario in space.scenarios if "learned" in scenario.source.kinds]
    wanted = [parse_task(task).name for source in learned for task in source.tasks]
    for source in found:
        if source.cell.task not in wanted:
            there = ", ".join(dict.fromkeys(wanted)) or "none"
            raise InputError(
                f"--source {source.name} was trained on {source.cell.task}, but the learned sources of {space.name} "
                f"are of {there}"
            )
        _check_shape(source.name, source.knowledge, parse_task(source.cell.task))
    _check_together(found)
    return found


def read_one(name: str, uri: str) -> Pretrained:
    """Return the source called `name`, without a check of its shapes. Raises InputError if it is missing or damaged."""
    return _model(name, uri) if name.startswith("models:") else _file(Path(name))


def keep(found: Sequence[Pretrained], results: Results) -> None:
    """Add the sources to the library of a sweep, and record their names.

    Raises InputError where the library has different knowledge of the same cell.
    """
    library = SourceLibrary(results.storage)
    for source in found:
        if not library.has(source.cell.id):
            library.save(source.cell, source.knowledge)
        elif library.load(source.cell.id).digest != source.knowledge.digest:
            raise InputError(
                f"{library.path(source.cell.id)} has different knowledge of the same cell than {source.name}"
            )
    pretrained_names.write(results.folder, [source.name for source in found])


def runs(found: Sequence[Pretrained], seeds: Sequence[int]) -> Runs:
    """Return the source run of each seed: a single source of a task serves every seed, several serve their seeds."""
    by_task: dict[str, dict[int, SourceRun]] = {}
    for source in found:
        alone = sum(other.cell.task == source.cell.task for other in found) == 1
        serves = seeds if alone else [source.cell.seed]
        by_task.setdefault(source.cell.task, {}).update({seed: source.run(seed) for seed in serves})
    return by_task


def _model(name: str, uri: str) -> Pretrained:
    if said := without_registry(uri):
        raise InputError(f"{said}: '{name}' needs the --tracking-uri of an MLflow store")
    from orchestrator.model_registry.mlflow_registry import fetch

    version = fetch(name, uri)
    source, tags = _read(name, version.data), version.tags
    try:
        steps, best, auc = read_steps(tags["steps"]), float(tags["best_return"]), float(tags["auc"])
        digest = tags["digest"]
    except (KeyError, ValueError) as error:
        raise InputError(
            f"{version.uri} was not registered by deltatune: its tags are missing or malformed: {error}"
        ) from None
    if digest != source.knowledge.digest:
        raise InputError(f"{version.uri} is damaged: its arrays do not agree with its tag 'digest'")
    return Pretrained(version.uri, source.cell, source.knowledge, best, auc, steps)


def _file(path: Path) -> Pretrained:
    try:
        return _read(str(path), path.read_bytes())
    except OSError as error:
        raise InputError(f"cannot read the source {path}: {error.strerror}") from None


def _read(name: str, data: bytes) -> Pretrained:
    try:
        knowledge, meta = Knowledge.from_bytes(data)
        cell = Cell.from_json(meta.get("cell"))
    except InputError as error:
        raise InputError(f"{name} is no source: {error}") from None
    best = knowledge.arrays.get("best_return")
    return Pretrained(name, cell, knowledge, -math.inf if best is None or best.ndim else float(best), -math.inf, {})


def _check_shape(name: str, knowledge: Knowledge, task: Task) -> None:
    """Raise InputError unless the arrays are a finite table or network of the task's shape."""
    try:
        if task.tabular:
            dynamics = task.dynamics()
            knowledge.q_table((dynamics.states, dynamics.actions))
        else:
            _check_network(knowledge.arrays, task)
    except InputError as error:
        raise InputError(f"{name} does not fit {task.name}: {error}") from None


def _check_network(arrays: Mapping[str, np.ndarray[Any, Any]], task: Task) -> None:
    from trainables.tasks.shape import task_shape

    missing = {"sizes", "best", "last", "steps"} - set(arrays)
    if missing:
        raise InputError(f"it lacks the array {sorted(missing)[0]}")
    for name, axes in (("sizes", 1), ("steps", 0)):
        if arrays[name].dtype.kind != "i" or arrays[name].ndim != axes:
            raise InputError(f"its array {name} is {arrays[name].dtype} of shape {arrays[name].shape}")
    sizes, (inputs, actions) = [int(size) for size in arrays["sizes"]], task_shape(task)
    if sizes and (sizes[0], sizes[-1]) != (inputs, actions):
        raise InputError(f"its network has {sizes[0]} inputs and {sizes[-1]} actions, not {inputs} and {actions}")
    count = sum((n_in + 1) * n_out for n_in, n_out in itertools.pairwise(sizes))
    for vector in (arrays["best"], arrays["last"]):
        if vector.dtype != np.float32 or vector.ndim != 1 or (sizes and len(vector) != count):
            raise InputError(f"its parameters are {vector.dtype} of shape {vector.shape}, not float32 of ({count},)")
        if not np.isfinite(vector).all():
            raise InputError("its network holds a NaN or an infinity")


def _check_together(found: Sequence[Pretrained]) -> None:
    """Raise InputError where several sources of one task differ in more than their seed."""
    first: dict[str, Pretrained] = {}
    for source in found:
        other = first.setdefault(source.cell.task, source)
        if other is not source and other.cell.group != source.cell.group:
            raise InputError(f"--source {other.name} and {source.name} have different agents or hyperparameters")
    kinds = [(source.cell.task, source.cell.seed) for source in found]
    for source, kind in zip(found, kinds, strict=True):
        if kinds.count(kind) > 1:
            raise InputError(f"--source {source.name}: there are two of seed {source.cell.seed} on {source.cell.task}")
