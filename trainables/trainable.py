"""The Ray Tune shells around `train`: one trainable per agent/task pair, and the one that a sweep runs its cells by."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from ray import tune

from trainables import curve
from trainables.agents import AGENTS, agent_named
from trainables.cell import Cell, Source
from trainables.cell_run import run_cell
from trainables.errors import InputError
from trainables.evaluation import EvalPoint
from trainables.knowledge import Knowledge
from trainables.tasks import families, parse_task
from trainables.threads import one_thread
from trainables.training import exact_source, train

Config = dict[str, Any]

PROGRESS_SECONDS = 2.0
"""Time between reports of a long cell's progress."""

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
) -> None:
    """A sweep's trainable: run the cells of config["cells"] one after the other, and report each when it ends.

    sources: the arrays of each source, by `Cell.source_key`. keep: whether what each has learned is wanted too.
    checkpoints: the folder for the states of long cells, each saved once in `checkpoint_seconds` at the most.
    A report has `ended`, the outcomes that the sweep's callback takes over, or `progress`, the share of a long cell
    that is done. A cell that fails is an outcome like another, and the next one runs.
    """
    one_thread()
    for data in config["cells"]:
        cell = Cell.from_json(data)
        outcome = run_cell(
            cell,
            lambda cell: Knowledge((sources or {})[cell.source_key]) if cell.source else None,
            keep=keep,
            checkpoints=Path(checkpoints) if checkpoints else None,
            checkpoint_seconds=checkpoint_seconds,
            on_point=_Progress(cell),
        )
        tune.report({"ended": [outcome]})


class _Progress:
    """Reports how far a long cell is, every other second."""

    def __init__(self, cell: Cell) -> None:
        self._cell, self._episodes = cell, cell.settings.episodes
        self._reported = time.monotonic()

    def __call__(self, point: EvalPoint) -> None:
        """Report, unless the last report is not long ago."""
        if time.monotonic() - self._reported >= PROGRESS_SECONDS:
            self._reported = time.monotonic()
            share = point.episode / self._episodes
            tune.report({"progress": {"cell": self._cell.id, "share": share, "greedy_return": point.greedy_return}})
