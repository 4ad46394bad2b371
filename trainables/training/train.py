"""train(cell, source): one cell from its first greedy evaluation to its last. No Ray, no MLflow."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Mapping
from typing import Any

from trainables.cell import Cell
from trainables.curve import EvalPoint
from trainables.delta.exact import exact_q
from trainables.errors import InputError
from trainables.knowledge import Knowledge, joined
from trainables.learners.learner import Resumable, new_learner
from trainables.tasks.registry import parse_task
from trainables.training.policy import Policy, learned_policy


class Training(Iterator[EvalPoint]):
    """The evaluation points of one cell, each computed when it is asked for."""

    def __init__(self, cell: Cell, source: Knowledge | None = None) -> None:
        self.cell = cell
        self._learner = new_learner(cell, source)
        self._episodes: int | None = None
        self._started = time.perf_counter()

    def __next__(self) -> EvalPoint:
        """Train up to the next evaluation, and evaluate. Raises TrainingError for a point with a number not finite."""
        settings = self.cell.settings
        if self._episodes is None:
            self._episodes = 0
        elif self._episodes >= settings.episodes:
            raise StopIteration
        else:
            block = min(settings.evaluate_every, settings.episodes - self._episodes)
            self._learner.run(block)
            self._episodes += block
        return EvalPoint.checked(self._learner.evaluate(), time.perf_counter() - self._started)

    def knowledge(self) -> Knowledge:
        """What the agent has learned so far: after the last point, the source knowledge of a later transfer."""
        return self._learner.knowledge()

    def policy(self) -> Policy:
        """Return the greedy policy as it stands; InputError for a custom learner that does not say it."""
        return learned_policy(self._learner)

    @property
    def resumable(self) -> bool:
        """Whether `state` and `restore` work: those of a custom learner that lacks them do not."""
        return isinstance(self._learner, Resumable)

    def state(self) -> dict[str, Any]:
        """Everything needed to go on after the last point, for `checkpoint.save`."""
        assert isinstance(self._learner, Resumable)
        seconds = time.perf_counter() - self._started
        return {
            "cell": self.cell.id,
            "episodes": self._episodes,
            "seconds": seconds,
            "learner": self._learner.state(),
        }

    def restore(self, state: Mapping[str, Any]) -> None:
        """Go on from what `state` returned. Raises InputError where it is another cell's."""
        assert isinstance(self._learner, Resumable)
        if state["cell"] != self.cell.id:
            raise InputError(f"the checkpoint is of cell {state['cell']}, not of {self.cell.id}")
        self._episodes = state["episodes"]
        self._started = time.perf_counter() - state["seconds"]
        self._learner.restore(state["learner"])

    def close(self) -> None:
        """Let the learner close what it holds open, such as its environments, where it has a `close`."""
        close = getattr(self._learner, "close", None)
        if callable(close):
            close()


def train(cell: Cell, source: Knowledge | None = None) -> Training:
    """Iterate over the EvalPoints of `cell`; equal bits wherever and whenever it runs.

    source: the knowledge that `cell.sources` name. An exact source is computed where it is not given.
    Raises InputError where a learned source is missing or does not fit the task.
    """
    if cell.sources and source is None:

        def missing(cell_id: str) -> Knowledge:
            raise InputError(f"cell {cell.id} needs the knowledge of its source cell {cell_id}")

        source = source_knowledge(cell, missing)
    return Training(cell, source)


def source_knowledge(cell: Cell, load: Callable[[str], Knowledge]) -> Knowledge:
    """What the sources of `cell` know, as one: learned ones by `load(cell_id)`, exact ones computed."""
    return joined(
        [
            load(str(source.cell_id))
            if source.kind == "learned"
            else exact_source(source.task, float(cell.hyperparameters["gamma"]))
            for source in cell.sources
        ]
    )


def exact_source(task: str, gamma: float) -> Knowledge:
    """Q* of `task` by value iteration, as source knowledge."""
    return Knowledge({"q": exact_q(parse_task(task).name, gamma)})
