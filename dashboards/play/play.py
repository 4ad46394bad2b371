"""Plays an episode of each actor from the same seed, and films them side by side."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from dashboards.play import gridworld
from dashboards.play.episode import Episode, Image, rendered, walked, without_display
from dashboards.play.film import panels
from orchestrator.execution.actors import Actor
from trainables.errors import InputError
from trainables.tasks.spec.family import Task

GRIDWORLD = "windy_gridworld"


def play(task: Task, actors: Sequence[Actor], seed: int) -> tuple[list[Episode], Iterator[Image]]:
    """Return the episodes and the images of the film. Raises InputError for a task that cannot be drawn."""
    without_display()
    if task.family.name == GRIDWORLD:
        walks = [walked(task, actor.title, actor.policy, seed) for actor in actors]
        return walks, gridworld.images(task.context, walks, [actor.delta for actor in actors])
    if task.tabular:
        raise InputError(f"{task.name} cannot be played: it has no picture of its states")
    episodes = [rendered(task, actor.title, actor.policy, seed) for actor in actors]
    return episodes, panels(episodes)
