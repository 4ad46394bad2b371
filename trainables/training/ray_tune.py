"""The Ray Tune shells around `train`: one trainable per agent/task pair, and the one that a sweep runs its cells by."""

from __future__ import annotations

import contextlib
import math
import os
import time
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import ray
from ray import tune

from trainables import curve
from trainables.agents.registry import AGENTS, agent_named
from trainables.cell import Cell, Source
from trainables.curve import EvalPoint
from trainables.errors import InputError
from trainables.knowledge import Knowledge
from trainables.numerics.threads import one_thread
from trainables.plugins import loader
from trainables.storage.paths import storage_path
from trainables.tasks.registry import families, parse_task
from trainables.training.cell_run import CellRun, GiveSource, Outcome, run_cell
from trainables.training.lockstep import lockstep
from trainables.training.train import exact_source, train

Config = dict[str, Any]

PROGRESS_SECONDS = 2.0
"""Time between reports of a long cell's progress."""

OUTCOME_SECONDS = 1.0
"""Time between reports of ended cells, and between two looks for the driver's wish to stop."""

STOP = "STOP"
"""The file in the checkpoints' folder by which the driver asks its workers to stop."""

RESERVED = ("seed", "source", "source_file")
"""Keys of a trainable's config that are no hyperparameters."""


def trainable(agent: str, task: str) -> Callable[[Config], None]:
    """A function trainable for `tune.Tuner` that trains `agent` on `task` and reports each greedy evaluation.

    config: the agent's hyperparameters, and
      seed         (default 0)
      source       the source task (default: the task's family at its defaults)
      source_file  a file of the source library (.npz); without it the source is exact, which only tabular tasks have
    Each report has episode, step, greedy_return, discounted_return, training_return, the statistics of delta and
    the gate, auc (the mean of the curve so far) and cell_id. Raises InputError for an unknown agent or task.
    """
    named, parsed = agent_named(agent), parse_task(task)

    def run(config: Config) -> None:
        cell, knowledge = _cell(named.name, parsed.name, config)
        returns: list[float] = []
        for point in train(cell, knowledge):
            returns.append(point.greedy_return)
            tune.report(metrics(point) | {"auc": curve.auc(returns), "cell_id": cell.id})

    run.__name__ = f"{agent}/{parsed.name}"
    return run


def metrics(point: EvalPoint) -> dict[str, float]:
    """An evaluation as a flat dictionary of numbers; what the point lacks is left out."""
    values = {field: getattr(point, field) for field in curve.FIELDS} | dict(point.statistics)
    values["steps_per_second"] = point.step / point.seconds if point.seconds else None
    return {name: value for name, value in values.items() if value is not None}


def register_all() -> list[str]:
    """Register every agent with every task of the paper under the name `agent/task`; the names, in order."""
    names = []
    for family in families().values():
        for task in dict.fromkeys((family.name, *family.targets)):
            for agent in AGENTS.values():
                if (agent.kind == "tabular") == parse_task(task).tabular:
                    tune.register_trainable(f"{agent.name}/{task}", trainable(agent.name, task))
                    names.append(f"{agent.name}/{task}")
    return names


def _cell(agent: str, task: str, config: Config) -> tuple[Cell, Knowledge | None]:
    values = {key: value for key, value in config.items() if key not in RESERVED}
    if not agent_named(agent).needs_source:
        return Cell.create(agent, task, config.get("seed", 0), values), None
    source_task = parse_task(config.get("source", parse_task(task).family.name)).name
    if "source_file" not in config:
        if not parse_task(source_task).tabular:
            raise InputError(f"{agent} needs source_file, a file of the source library trained on {source_task}")
        cell = Cell.create(agent, task, config.get("seed", 0), values, Source(task=source_task, kind="exact"))
        return cell, exact_source(source_task, cell.settings.gamma)
    path = Path(config["source_file"])
    checkpoint: Any = "last" if parse_task(source_task).tabular else "best"
    source = Source(task=source_task, kind="learned", cell_id=path.stem, checkpoint=checkpoint)
    return Cell.create(agent, task, config.get("seed", 0), values, source), Knowledge.from_bytes(path.read_bytes())[0]


def run_cells(
    config: Config,
    sources: Mapping[str, Mapping[str, np.ndarray]] | None = None,
    keep: bool = False,
    checkpoints: str | None = None,
    checkpoint_seconds: float = 5.0,
    own: Mapping[str, bytes] | None = None,
) -> None:
    """A sweep's trainable: run the cells of config["cells"] one after the other, and report what comes of each.

    config["together"]: run them side by side, and report after each evaluation for a scheduler to judge.
    sources: the arrays of each source, by `Cell.source_key`. keep: whether what each has learned is wanted too.
    checkpoints: the folder for the states of long cells, each saved once in `checkpoint_seconds` at the most; a file
    STOP in it asks for a checkpoint and an end. own: the own files that the driver has loaded (`plugins.files.packed`).
    The first report has `worker`, where this is. A later one has `ended`, the outcomes that the sweep's callback takes
    over; or `progress`, the share of a long cell that is done; or `evaluations`, `score` and the curves' new `points`.
    A cell that fails is an outcome like another, and the next one runs.
    """
    one_thread()
    loader.install(own or {})
    tune.report({"worker": {"pid": os.getpid(), "node": ray.get_runtime_context().get_node_id()}})
    folder = storage_path(checkpoints) if checkpoints else None
    options: dict[str, Any] = {
        "keep": keep,
        "checkpoints": folder,
        "checkpoint_seconds": checkpoint_seconds,
        "saved": _saved(folder),
    }
    cells = [Cell.from_json(data) for data in config["cells"]]
    stop = StopFile(folder)

    def source(cell: Cell) -> Knowledge | None:
        return Knowledge((sources or {})[cell.source_key]) if cell.sources else None

    if config.get("together"):
        _run_together([CellRun(cell, source, **options) for cell in cells], stop)
    else:
        _run_in_turn(cells, source, options, stop)


def _saved(folder: Path | None) -> set[str] | None:
    """The cells that have a checkpoint, asked once for all of a trial's; None where the storage does not say."""
    with contextlib.suppress(Exception):
        return {path.stem for path in folder.glob("*.checkpoint")} if folder else set()
    return None


def _run_in_turn(cells: Sequence[Cell], source: GiveSource, options: dict[str, Any], stop: StopFile) -> None:
    """One cell after the other; the outcomes of short ones are reported together."""
    outcomes: list[Outcome] = []
    reported = time.monotonic()
    for cell in cells:
        outcome = run_cell(cell, source, **options, on_point=_Progress(cell), stop=stop)
        if outcome is not None:
            outcomes.append(outcome)
        if outcomes and time.monotonic() - reported >= OUTCOME_SECONDS:
            tune.report({"ended": outcomes})
            outcomes, reported = [], time.monotonic()
        if stop():
            break
    if outcomes:
        tune.report({"ended": outcomes})


def _run_together(runs: Sequence[CellRun], stop: StopFile) -> None:
    """The seeds of a configuration in lockstep, as far as Tune's scheduler lets them."""
    told = {run.cell.id: 0 for run in runs}
    for rung in lockstep(runs, stop):
        points = [(run.cell.id, run.points(told[run.cell.id])) for run in runs]
        told = {run.cell.id: run.evaluations for run in runs}
        tune.report({"evaluations": rung.evaluations, "score": rung.score, "points": points})
    if ended := [run.outcome() for run in runs if run.ended]:
        tune.report({"ended": ended})


class StopFile:
    """Whether the driver has asked its workers to stop; looked up once a second at the most."""

    def __init__(self, folder: Path | None) -> None:
        self._path = folder / STOP if folder else None
        self._looked = -math.inf
        self._there = False

    def __call__(self) -> bool:
        """Whether to stop."""
        if self._path is not None and not self._there and time.monotonic() - self._looked >= OUTCOME_SECONDS:
            self._looked = time.monotonic()
            with contextlib.suppress(Exception):  # a storage that is away is no reason to stop
                self._there = self._path.exists()
        return self._there


class _Progress:
    """Reports how far a long cell is, every other second."""

    def __init__(self, cell: Cell) -> None:
        self._cell, self._episodes = cell, cell.settings.episodes
        self._reported = time.monotonic()

    def __call__(self, point: EvalPoint) -> None:
        """Report, unless the last report is not long ago."""
        if time.monotonic() - self._reported >= PROGRESS_SECONDS:
            self._reported = time.monotonic()
            progress = {"cell": self._cell.id, "share": point.episode / self._episodes, "step": point.step}
            tune.report({"progress": progress | {"greedy_return": point.greedy_return}})
