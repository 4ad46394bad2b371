"""The interface of learners, and how they are built."""

from __future__ import annotations

import logging
from collections.abc import Iterable, Mapping
from typing import Any, Protocol, runtime_checkable

from trainables.agents.named import entry
from trainables.agents.registry import agent_named
from trainables.cell import Cell
from trainables.curve import EvalPoint
from trainables.extras import require
from trainables.knowledge import Knowledge

log = logging.getLogger("deltatune.learners")


class Learner(Protocol):
    """Trains one cell. `Agent.learner` names a class that is built from (cell, source)."""

    def run(self, episodes: int) -> None:
        """Train for `episodes` more episodes."""

    def evaluate(self) -> EvalPoint:
        """Return the next point of the evaluation curve."""

    def knowledge(self) -> Knowledge:
        """Return what has been learned so far."""


@runtime_checkable
class Resumable(Learner, Protocol):
    """A learner whose whole state can be saved between two evaluations."""

    def state(self) -> dict[str, Any]:
        """Return arrays and plain data that `checkpoint.save` accepts."""

    def restore(self, state: Mapping[str, Any]) -> None:
        """Restore what `state` returned; training then continues bit for bit as before."""


def prepare(agents: Iterable[str]) -> None:
    """Import the learners of some agents, which takes seconds the first time in a process."""
    for name in agents:
        try:
            entry(agent_named(name).learner)
        except Exception as error:  # each of its cells fails with this sentence
            log.info("the learner of %s cannot be imported: %s", name, error)


def new_learner(cell: Cell, source: Knowledge | None) -> Learner:
    """Return a new learner of `cell`. Raises InputError where it needs an extra that is missing."""
    agent = agent_named(cell.agent)
    require({agent.name: agent.extra})
    learner: Learner = entry(agent.learner)(cell, source)
    return learner
