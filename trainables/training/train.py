"""train(cell, source): trains one cell from its first greedy evaluation to its last, without Ray and MLflow."""

from __future__ import annotations

import time
from collections.abc import Iterator, Mapping
from typing import Any

from trainables.cell import Cell
from trainables.curve import EvalPoint
from trainables.errors import InputError
from trainables.knowledge import Knowledge
from trainables.learners.learner import Resumable, new_learner
from trainables.training.policy import Policy, learned_policy
from trainables.training.source_knowledge import source_knowledge


class Training(Iterator[EvalPoint]):
    """Iterates over the evaluation points of a cell, computing each on demand."""

    def __init__(self, cell: Cell, source: Knowledge | None = None) -> None:
        self.cell = cell
        self._learner = new_learner(cell, source)
        self._episodes: int | None = None
        self._started = time.perf_counter()

    def __next__(self) -> EvalPoint:
        """Train up to the next evaluation, and return its point. Raises TrainingError for NaN and infinities."""
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
        """Return what the agent has learned so far, which can be the source knowledge of a later transfer."""
        return self._learner.knowledge()

    def policy(self) -> Policy:
        """Return the present greedy policy. Raises InputError for a custom learner that does not define one."""
        return learned_policy(self._learner)

    @property
    def resumable(self) -> bool:
        """Whether `state` and `restore` work; a custom learner may lack them."""
        return isinstance(self._learner, Resumable)

    def state(self) -> dict[str, Any]:
        """Return everything needed to continue after the last point, for `checkpoint.save`."""
        assert isinstance(self._learner, Resumable)
        seconds = time.perf_counter() - self._started
        return {
            "cell": self.cell.id,
            "episodes": self._episodes,
            "seconds": seconds,
            "learner": self._learner.state(),
        }

    def restore(self, state: Mapping[str, Any]) -> None:
        """Continue from what `state` returned, of this cell, or of one that differs only in having fewer episodes.

        Raises InputError for another cell's state.
        """
        assert isinstance(self._learner, Resumable)
        if state["cell"] != self.cell.id and not self._continues(state):
            raise InputError(f"the checkpoint is of cell {state['cell']}, not of {self.cell.id}")
        self._episodes = state["episodes"]
        self._started = time.perf_counter() - state["seconds"]
        self._learner.restore(state["learner"])

    def _continues(self, state: Mapping[str, Any]) -> bool:
        """Return whether a state is the end of a cell that differs only in having fewer episodes."""
        episodes = int(state["episodes"])
        shorter = 0 < episodes < self.cell.episodes
        return shorter and state["cell"] == self.cell.with_episodes(episodes).id

    def close(self) -> None:
        """Call the learner's `close` if it has one, which closes its environments."""
        close = getattr(self._learner, "close", None)
        if callable(close):
            close()


def train(cell: Cell, source: Knowledge | None = None) -> Training:
    """Return an iterator over the EvalPoints of `cell`, with the same bits wherever it runs.

    source: the knowledge of `cell.sources`. An exact source is computed if it is not given.
    Raises InputError where a learned source is missing or does not fit the task.
    """
    if cell.sources and source is None:

        def missing(cell_id: str) -> Knowledge:
            raise InputError(f"cell {cell.id} needs the knowledge of its source cell {cell_id}")

        source = source_knowledge(cell, missing)
    return Training(cell, source)
