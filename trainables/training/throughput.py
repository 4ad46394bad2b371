"""Measures the speed of an agent on a task, and estimates the cost of its cells."""

from __future__ import annotations

import time
from dataclasses import dataclass
from typing import Any

from trainables.agents.registry import agent_named
from trainables.cell import Cell, Source
from trainables.knowledge import Knowledge, joined
from trainables.learners.learner import Learner, new_learner
from trainables.tasks.make import make_env
from trainables.tasks.registry import parse_task

SECONDS = 1.0
"""Length of one measurement."""

WINDOWS = 2
"""Parts of a measurement, of which the faster one counts, since the other may include compilation."""

EVALUATION_EPISODES = 5
"""Largest number of episodes of an evaluation while measuring."""


@dataclass(frozen=True)
class Rate:
    """The measured speed of an agent's training on a task."""

    seconds_per_step: float
    """Environment step and learner update together."""
    steps_per_episode: float
    """In the measured episodes, which are an agent's first."""
    time_limit: int
    """Largest number of steps of an episode."""
    seconds_per_evaluation: float

    def seconds(self, hyperparameters: dict[str, Any], steps_per_episode: float | None = None) -> float:
        """Return the seconds of a cell, with episodes of that many steps (default: as measured)."""
        steps = steps_per_episode or self.steps_per_episode
        episodes = int(hyperparameters["episodes"])
        evaluations = 1 + -(-episodes // int(hyperparameters["evaluate_every"]))
        ratio = steps / self.steps_per_episode
        return episodes * steps * self.seconds_per_step + evaluations * ratio * self.seconds_per_evaluation


def measure(cell: Cell) -> Rate:
    """Train `cell` for about SECONDS, with a placeholder source that is hardly trained; return its speed.

    Raises whatever the task's code raises.
    """
    cell, scale = _with_short_evaluations(cell)
    learner = new_learner(cell, _stand_in(cell) if cell.sources else None)
    before = 0
    while before <= int(cell.hyperparameters.get("batch_size", 0)):  # until it updates, and is compiled
        learner.run(1)
        before = learner.evaluate().step
    windows = []
    for _ in range(WINDOWS):
        begun, episodes = time.perf_counter(), 0
        while (spent := time.perf_counter() - begun) < SECONDS / WINDOWS:
            learner.run(1)
            episodes += 1
        begun, after = time.perf_counter(), learner.evaluate().step
        windows.append((spent / (after - before), (after - before) / episodes, time.perf_counter() - begun))
        before = after
    per_step, per_episode, evaluation = min(windows)
    return Rate(per_step, per_episode, _time_limit(cell.task), scale * evaluation)


def _with_short_evaluations(cell: Cell) -> tuple[Cell, float]:
    """Return the cell with few episodes per evaluation, and how much longer its original evaluations take."""
    episodes = int(cell.hyperparameters.get("evaluation_episodes", 0))
    if episodes <= EVALUATION_EPISODES:
        return cell, 1.0
    values = dict(cell.hyperparameters) | {"evaluation_episodes": EVALUATION_EPISODES}
    return Cell.create(cell.agent, cell.task, cell.seed, values, cell.sources), episodes / EVALUATION_EPISODES


def _stand_in(cell: Cell) -> Knowledge:
    """Return the knowledge of the cell's base agent after one episode on each source task."""
    agent = agent_named(cell.agent)
    base = agent_named(str(agent.base))
    values = {key: value for key, value in cell.hyperparameters.items() if key in base.hyperparameters.model_fields}
    learners: list[Learner] = [
        new_learner(Cell.create(base.name, source.task, cell.seed, values), None) for source in cell.sources
    ]
    for learner in learners:
        learner.run(1)
    return joined([learner.knowledge() for learner in learners])


def probe(agent: str, task: str, source: str | None, hyperparameters: dict[str, Any]) -> Cell:
    """Return a cell to measure; `source` is the source task of an agent that needs one."""
    needs = agent_named(agent).needs_source
    given = Source(task=source or task, kind="learned", cell_id="0" * 16, steps=10_000_000) if needs else None
    if given is not None and parse_task(given.task).tabular:
        given = given.model_copy(update={"steps": None})
    return Cell.create(agent, task, 0, hyperparameters, given)


def _time_limit(task: str) -> int:
    from trainables.tasks.wrappers.unwrap import unwrap

    env = make_env(parse_task(task))
    limit = unwrap(env)[1]
    env.close()
    return limit
