"""The Ray Tune shells around `train`: one trainable per agent/task pair, and the one that a sweep runs its cells by."""

from __future__ import annotations

import time
import traceback
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from ray import tune

from trainables import curve
from trainables.agents import AGENTS, agent_named
from trainables.cell import Cell, Source
from trainables.evaluation import EvalPoint
from trainables.knowledge import Knowledge
from trainables.tasks import families, parse_task
from trainables.training import exact_source, train

Config = dict[str, Any]

RESERVED = ("seed", "source", "source_file")
"""Keys of a trainable's config that are no hyperparameters."""


def trainable(agent: str, task: str) -> Callable[[Config], None]:
    """A function trainable for `tune.Tuner` that trains `agent` on `task` and reports each greedy evaluation.

    config: the agent's hyperparameters, and
      seed         (default 0)
      source       the source task (default: the task's family at its defaults); its Q_src is exact, unless
      source_file  names a file of the source library (.npz)
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
        cell = Cell.create(agent, task, config.get("seed", 0), values, Source(task=source_task, kind="exact"))
        return cell, exact_source(source_task, cell.settings.gamma)
    path = Path(config["source_file"])
    source = Source(task=source_task, kind="learned", cell_id=path.stem)
    return Cell.create(agent, task, config.get("seed", 0), values, source), Knowledge.from_bytes(path.read_bytes())[0]


def run_cells(
    config: Config, sources: Mapping[str, Mapping[str, np.ndarray]] | None = None, keep: bool = False
) -> None:
    """A sweep's trainable: train the cells of config["cells"] one after the other, and report each when it ends.

    sources: the arrays of each source, by `Cell.source_key`. keep: whether what each has learned is wanted too.
    A report has `ended`: the outcome of one cell, to be taken over by the sweep's callback. A cell that fails is
    reported as failed, and the next one runs.
    """
    for data in config["cells"]:
        tune.report({"ended": [outcome(Cell.from_json(data), sources or {}, keep)]})


def outcome(cell: Cell, sources: Mapping[str, Mapping[str, np.ndarray]], keep: bool) -> dict[str, Any]:
    """Train one cell to its end: {cell, status, error, points, digest, seconds, knowledge}."""
    started = time.perf_counter()
    points: list[EvalPoint] = []
    error, knowledge = None, None
    try:
        arrays = sources[cell.source_key] if cell.source else None
        training = train(cell, Knowledge(arrays) if arrays is not None else None)
        points.extend(training)
        knowledge = training.knowledge().to_bytes() if keep else None
    except Exception as exception:
        where = traceback.extract_tb(exception.__traceback__)[-1]
        error = f"{type(exception).__name__}: {exception} ({Path(where.filename).name}:{where.lineno})"
    table = curve.columns(points)
    return {
        "cell": cell.to_json(),
        "status": "failed" if error else "done",
        "error": error,
        "points": table,
        "digest": curve.digest(table),
        "seconds": time.perf_counter() - started,
        "knowledge": knowledge,
    }
