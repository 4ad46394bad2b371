"""The ranking of library sources for a target."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import closing
from dataclasses import dataclass
from typing import Any

from orchestrator.sources.library import Entry
from trainables.agents.registry import agent_named
from trainables.errors import InputError
from trainables.source_ranking.ranking import Ranked, Ranking, SourceComparison, rank
from trainables.tasks.registry import parse_task
from trainables.tasks.shape import task_shape
from trainables.tasks.spec.family import Task


@dataclass(frozen=True)
class Found:
    """A ranking of library sources."""

    target: str
    entries: tuple[Entry, ...]
    """The sources that fit the target, in the order of `Ranked.source`."""
    ranking: Ranking
    unfit: int
    """Sources of other observations or actions, left out."""

    def to_json(self) -> dict[str, Any]:
        """Return the ranking as plain data."""
        best = self.ranking.recommended
        return {
            "target": self.target,
            "recommended": self.entries[best.source].id if best else None,
            "random_return": self.ranking.random_return,
            "steps": self.ranking.steps,
            "left_out": self.unfit,
            "sources": [self._row(ranked) for ranked in self.ranking.ranked],
        }

    def _row(self, ranked: Ranked) -> dict[str, Any]:
        entry, target, floor = self.entries[ranked.source], ranked.target, ranked.floor
        tried = ranked.high < float("inf")
        return {
            "id": entry.id,
            "task": entry.cell.task,
            "seed": entry.cell.seed,
            "verdict": ranked.verdict,
            "value": target.value if tried else None,
            "low": ranked.low if tried else None,
            "high": ranked.high if tried else None,
            "promise": target.promise if tried else None,
            "kept": ranked.kept[0] if tried else None,
            "kept_low": ranked.kept[1] if tried else None,
            "delta": target.delta,
            "self_delta": floor.delta,
            "self_path_delta": floor.path_delta,
            "unseen": target.unseen,
            "episodes": ranked.episodes,
        }


def rank_sources(target: str, entries: Sequence[Entry], episodes: int, seed: int) -> Found:
    """Rank the sources that fit `target` from so many episodes on it.

    Raises InputError where no source fits, or their discount factors differ.
    """
    if episodes < 2:
        raise InputError(f"episodes must be at least 2 (got {episodes})")
    task = parse_task(target)
    shape = task_shape(task)
    fitting = [entry for entry in entries if _fits(entry, task, shape)]
    if not fitting:
        what = "states" if task.tabular else "inputs"
        raise InputError(
            f"none of the {len(entries)} sources has {shape[0]} {what} and {shape[1]} actions like {target}"
        )
    gammas = {float(entry.cell.hyperparameters["gamma"]) for entry in fitting}
    if len(gammas) > 1:
        raise InputError(f"the sources have different discount factors ({', '.join(map(str, sorted(gammas)))})")
    fitting.sort(key=lambda entry: entry.id)
    with closing(_comparison(task, fitting, gammas.pop(), seed)) as comparison:
        ranking = rank(comparison, len(fitting), episodes)
    return Found(task.name, tuple(fitting), ranking, len(entries) - len(fitting))


def own_path_delta(target: str, entries: Sequence[Entry], episodes: int, seed: int) -> list[float]:
    """Return, for each source, the root mean square of delta on `target` along the source's own greedy path there.

    Every source plays so many episodes of the target, with the same random numbers.
    """
    task = parse_task(target)
    gamma = float(entries[0].cell.hyperparameters["gamma"])
    comparison = _comparison(task, entries, gamma, seed, at_home=target)
    return [following.delta for following in comparison.floors([episodes] * len(entries))]


def _fits(entry: Entry, target: Task, shape: tuple[int, int]) -> bool:
    source = parse_task(entry.cell.task)
    kind = "tabular" if target.tabular else "deep"
    same = source.family is target.family or (source.family.origin != "missing" and task_shape(source) == shape)
    return same and agent_named(entry.cell.agent).kind == kind


def _comparison(task: Task, entries: Sequence[Entry], gamma: float, seed: int, at_home: str = "") -> SourceComparison:
    """Return the comparison of sources on a target. at_home: the task that stands for each source's own, if given."""
    if task.tabular:
        from trainables.source_ranking.tabular import TabularComparison

        shape = task_shape(task)
        tables = [(at_home or e.cell.task, e.knowledge.q_table(shape)) for e in entries]
        return TabularComparison(task.name, tables, gamma, seed)
    from trainables.agents.builtin.dqn import DQN
    from trainables.networks.network import source_network
    from trainables.source_ranking.deep import DeepComparison

    networks = []
    for entry in entries:
        settings = entry.cell.settings
        assert isinstance(settings, DQN)
        network = source_network(entry.knowledge, "best", settings, *task_shape(task))
        networks.append((at_home or entry.cell.task, network))
    return DeepComparison(task.name, networks, gamma, seed)
