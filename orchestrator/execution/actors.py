"""The greedy policies that can be filmed: a cell's agent and its sources, a registered model, a source file."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from orchestrator.execution.replay import find
from orchestrator.model_registry.pretrained import read_one
from orchestrator.sources.library import SourceLibrary
from trainables.cell import Cell
from trainables.delta.exact import exact_delta
from trainables.knowledge import Knowledge, parts
from trainables.numerics.threads import one_thread
from trainables.plugins.names import short
from trainables.tasks.registry import parse_task
from trainables.tasks.spec.family import Task
from trainables.training.policy import Policy, source_policy
from trainables.training.source_knowledge import source_knowledge
from trainables.training.train import train

MAX_SOURCES = 3
"""Sources shown with an agent that chooses among several."""


@dataclass(frozen=True)
class Actor:
    """A greedy policy with its title."""

    title: str
    policy: Policy
    delta: NDArray[np.float64] | None = None
    """(S,), tabular tasks: max_a |delta(s, a)| of the source that the agent used, or of its own values without one."""


@dataclass(frozen=True)
class Cast:
    """The actors and the task on which they act."""

    task: Task
    actors: tuple[Actor, ...]
    """The agent, then its sources."""


def cast(
    name: str,
    storage: Path,
    uri: Callable[[], str],
    *,
    task: str | None = None,
    sweep: str | None = None,
    on_training: Callable[[Cell], None] = lambda cell: None,
) -> Cast:
    """Return the actors for a cell's id, models:/NAME@ALIAS, or the path of a source file (.npz).

    A cell whose knowledge is not in the source library is first trained again, which gives the same bits; on_training
    is called before. task: where they act; default: the cell's task. Raises InputError for what is unknown or unfit.
    """
    if name.startswith("models:") or name.endswith(".npz"):
        source = read_one(name, uri() if name.startswith("models:") else "")
        target = parse_task(task or source.cell.task)
        return Cast(target, (_source(source.cell, source.knowledge, target, "best"),))
    library = SourceLibrary(storage)
    if sweep is None and name in library.ids():
        entry = library.entry(name)
        target = parse_task(task or entry.cell.task)
        return Cast(target, (_source(entry.cell, entry.knowledge, target, "best"),))
    results = find(storage, name, sweep)
    record = results.record(name)
    assert record is not None
    target = parse_task(task or record.cell.task)
    on_training(record.cell)
    return Cast(target, _trained(record.cell, SourceLibrary(results.storage), target))


def _trained(cell: Cell, library: SourceLibrary, target: Task) -> tuple[Actor, ...]:
    """Return a cell's agent, trained again, and its sources."""
    one_thread()
    source = source_knowledge(cell, library.load) if cell.sources else None
    training = train(cell, source)
    for _ in training:
        pass
    actors = []
    each = parts(source, len(cell.sources)) if source is not None else []
    for number, knowledge in enumerate(each[:MAX_SOURCES]):
        origin = cell.sources[number]
        trained_by = library.entry(origin.cell_id).cell if origin.cell_id else cell
        title = f"{origin.kind} source: {short(origin.task)}"
        actors.append(_source(trained_by, knowledge, target, origin.checkpoint, title))
    delta = actors[0].delta if actors else _delta(training.knowledge(), cell, target)
    return (Actor(f"{cell.agent}, seed {cell.seed}", training.policy(), delta), *actors)


def _source(cell: Cell, knowledge: Knowledge, target: Task, checkpoint: str, title: str = "") -> Actor:
    policy = source_policy(knowledge, cell, target, checkpoint)
    return Actor(
        title or f"{cell.agent} of {short(cell.task)}, seed {cell.seed}", policy, _delta(knowledge, cell, target)
    )


def _delta(knowledge: Knowledge, cell: Cell, target: Task) -> NDArray[np.float64] | None:
    """Return max_a |delta(s, a)| (S,) of the knowledge on the target; None where the target is not tabular."""
    if not target.tabular or "q" not in knowledge.arrays:
        return None
    model = target.model()
    q = knowledge.q_table(model.rewards.shape)
    largest: NDArray[np.float64] = np.abs(exact_delta(model, q, float(cell.hyperparameters["gamma"]))).max(axis=1)
    return largest
