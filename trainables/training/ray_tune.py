"""Ray Tune trainables around `train`: one per agent and task, and the one with which a sweep runs its cells."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

from ray import tune

from trainables import curve
from trainables.agents.registry import AGENTS, agent_named
from trainables.cell import Cell, Source
from trainables.curve import EvalPoint
from trainables.errors import InputError
from trainables.knowledge import Knowledge
from trainables.tasks.registry import families, parse_task
from trainables.training.source_knowledge import exact_source
from trainables.training.train import train

Config = dict[str, Any]

RESERVED = ("seed", "source", "source_file")
"""Keys of a trainable's config that are no hyperparameters."""


def trainable(agent: str, task: str) -> Callable[[Config], None]:
    """Return a function trainable for `tune.Tuner` that trains `agent` on `task` and reports each greedy evaluation.

    config: the agent's hyperparameters, and
      seed         (default 0)
      source       the source task (default: the task's family at its defaults)
      source_file  a file of the source library (.npz); without it the source is exact, which needs a tabular task
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
    """Return an evaluation as a flat dictionary of numbers, without missing ones."""
    values = {field: getattr(point, field) for field in curve.FIELDS} | dict(point.statistics)
    values["steps_per_second"] = point.step / point.seconds if point.seconds else None
    return {name: value for name, value in values.items() if value is not None}


def register_all() -> list[str]:
    """Register every agent with every task of the paper under the name `agent/task`, and return the names."""
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
