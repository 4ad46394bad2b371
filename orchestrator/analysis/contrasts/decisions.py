"""The decisions of a sweep with `seeds: auto`: each comparison of two configurations, tested group of seeds by group.

A target task has one family of comparisons: every configuration against those of the agents that it builds on, with the
same source and the same values of the hyperparameters that both have.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import pandas as pd

from orchestrator.analysis.contrasts.contrast import of_interest
from orchestrator.analysis.inference.adastop import Design, Outcome, Pair, decide
from orchestrator.analysis.labels import settings_text, varied
from search_spaces.search_space import SearchSpace
from trainables.plugins.names import short
from trainables.tasks.registry import parse_task

COLUMNS = ("task", "A", "B", "source", "A - B", "seeds", "decision")

LEAD = (
    "The seeds ran group after group until every comparison on a target was decided or the budget was spent (AdaStop, "
    "arXiv 2306.10882). The stated error is the probability of one wrong decision or more among all on a target; "
    "undecided means that the budget did not suffice, not that two agents are equal. Intervals and p-values elsewhere "
    "do not account for seeds that stopped at a decision."
)


@dataclass(frozen=True)
class Side:
    """One configuration in a comparison."""

    group: str
    """The group id of the cells table."""
    agent: str
    source: str
    source_task: str
    """That of the knowledge, or for an agent without transfer the one whose baseline it is; empty: of all."""
    pick: str
    hyperparameters: Mapping[str, Any]


@dataclass(frozen=True)
class Decision:
    """What the sequential test says of A - B on a target."""

    task: str
    first: Side
    second: Side
    outcome: Outcome
    seeds: int
    """Seeds that were tested."""
    difference: float | None
    """The mean difference in AUC over these seeds; None before the first group has ended, or where a cell failed."""

    @property
    def text(self) -> str:
        """The decision in words."""
        return {
            "better": "A is better",
            "worse": "A is worse",
            "undecided": "undecided, budget spent",
            "open": "open: more seeds to run",
            "lost": "none: a cell failed",
        }[self.outcome.state]


@dataclass(frozen=True)
class Replay:
    """The sequential test, replayed from a cells table."""

    decisions: tuple[Decision, ...]
    looks: Mapping[str, int]
    """Group id to the groups of seeds that its configuration needs so far."""
    still_open: frozenset[str] = frozenset()
    """Group ids of configurations that may need more."""
    further: int = 0
    """Most cells that may be needed beyond these."""


def replay(space: SearchSpace, cells: pd.DataFrame) -> Replay:
    """Return the decisions of a sweep, from the first group of seeds on, and what has to run next.

    cells: the cells table. Depends on the AUC of each cell alone, in the order of the seeds. Empty for fixed seeds.
    """
    if space.sequential is None or cells.empty:
        return Replay((), {})
    design = Design(space.sequential.group, len(space.seeds) // space.sequential.group, space.sequential.alpha)
    decisions: list[Decision] = []
    looks: dict[str, int] = {}
    still_open: set[str] = set()
    further = 0
    targets = {parse_task(name).name for scenario in space.scenarios for name in scenario.targets}
    for task, frame in cells[cells["task"].isin(targets)].groupby("task", sort=False):
        frames = {str(key): part for key, part in frame.groupby("group", sort=False)}
        sides = {key: _side(key, part.iloc[0]) for key, part in frames.items()}
        scores = {key: _scores(part, space.seeds) for key, part in frames.items()}
        found = decide(scores, pairs_of(list(sides.values())), design)
        decisions += [_decision(str(task), sides, pair, one, scores, design) for pair, one in found.items()]
        for key in sides:
            mine = [one for pair, one in found.items() if key in pair]
            looks[key] = max([1, *(one.looks + (one.state == "open") for one in mine)])
            if any(one.state == "open" for one in mine):
                still_open.add(key)
                width = int(frames[key]["seed"].value_counts().max())
                further += (design.looks - looks[key]) * design.group * width
    return Replay(tuple(decisions), looks, frozenset(still_open), further)


def _side(key: str, row: pd.Series) -> Side:
    def text(name: str) -> str:
        return str(row[name]) if isinstance(row.get(name), str) else ""

    values = json.loads(row["hyperparameters"])
    return Side(key, text("agent"), text("source"), text("source_task") or text("baseline_for"), text("pick"), values)


def _scores(frame: pd.DataFrame, seeds: Sequence[int]) -> list[float]:
    """Return the AUC of each seed in order, up to the first that has not ended; NaN for a failed one.

    Of several source networks at a seed, the mean.
    """
    by_seed = {int(part["seed"].iloc[0]): part for _, part in frame.groupby("seed")}
    found = []
    for seed in seeds:
        part = by_seed.get(seed)
        if part is None or (part["status"] == "missing").any():
            break
        found.append(math.fsum(part["auc"]) / len(part) if (part["status"] == "done").all() else math.nan)
    return found


def pairs_of(sides: Sequence[Side]) -> list[Pair]:
    """Return the comparisons of a family, as group ids."""
    found = []
    for agents in of_interest(side.agent for side in sides):
        for first in (side for side in sides if side.agent == agents[0]):
            rivals = [side for side in sides if side.agent == agents[1] and _same_source(first, side)]
            alike = [side for side in rivals if _agree(first, side)] or rivals
            found += [(first.group, second.group) for second in alike]
    return found


def _same_source(first: Side, second: Side) -> bool:
    if "none" in (first.source, second.source):
        return not (first.source_task and second.source_task) or first.source_task == second.source_task
    keys = [(side.source, side.source_task, side.pick) for side in (first, second)]
    return keys[0] == keys[1]


def _agree(first: Side, second: Side) -> bool:
    """Return whether two configurations have the same values of the hyperparameters that both have."""
    common = first.hyperparameters.keys() & second.hyperparameters.keys()
    return all(first.hyperparameters[name] == second.hyperparameters[name] for name in common)


def _decision(
    task: str,
    sides: Mapping[str, Side],
    pair: Pair,
    outcome: Outcome,
    scores: Mapping[str, Sequence[float]],
    design: Design,
) -> Decision:
    seeds = outcome.looks * design.group
    means = [math.fsum(scores[key][:seeds]) / seeds if seeds else math.nan for key in pair]
    gap = means[0] - means[1]
    return Decision(task, sides[pair[0]], sides[pair[1]], outcome, seeds, None if math.isnan(gap) else gap)


def rows(found: Sequence[Decision]) -> list[tuple[str, ...]]:
    """Return each decision's line under COLUMNS, with what distinguishes configurations and sources of an agent."""
    several = len({side.source_task for each in found for side in (each.first, each.second) if side.source_task}) > 1
    return [
        (
            short(each.task),
            _name(each.first, each.task, found),
            _name(each.second, each.task, found),
            each.first.source + (f" from {short(each.first.source_task)}" if several else ""),
            "-" if each.difference is None else f"{each.difference:+.2f}",
            str(each.seeds),
            each.text,
        )
        for each in found
    ]


def _name(side: Side, task: str, found: Sequence[Decision]) -> str:
    """Return an agent with those of its settings in which its configurations on the task differ."""
    sides = [other for each in found if each.task == task for other in (each.first, each.second)]
    alike = [other.hyperparameters for other in sides if other.agent == side.agent]
    swept = {name: value for name, value in side.hyperparameters.items() if any(v.get(name) != value for v in alike)}
    return short(side.agent) + (f" ({settings_text(swept)})" if swept else "")


def numbers(decision: Decision) -> dict[str, Any]:
    """Return a decision as data: both configurations, the decision, and the seeds spent on it."""
    first, second = decision.first, decision.second
    return {
        "task": decision.task,
        "a": first.agent,
        "b": second.agent,
        "source": first.source,
        "source_task": first.source_task or None,
        "pick": first.pick or None,
        "a_settings": settings_text(varied(first.agent, decision.task, first.hyperparameters)),
        "b_settings": settings_text(varied(second.agent, decision.task, second.hyperparameters)),
        "a_group": first.group,
        "b_group": second.group,
        "decision": decision.outcome.state,
        "difference": decision.difference,
        "seeds": decision.seeds,
        "groups": decision.outcome.looks,
    }


NUMBERS = (
    *("task", "a", "b", "source", "source_task", "pick", "a_settings", "b_settings", "a_group", "b_group"),
    *("decision", "difference", "seeds", "groups"),
)
"""The columns of `number_table`."""


def number_table(found: Sequence[Decision]) -> pd.DataFrame:
    """Return a row per decision."""
    return pd.DataFrame([numbers(each) for each in found], columns=list(NUMBERS))


def caption(found: Sequence[Decision], space: SearchSpace) -> str:
    """Return the title of the decisions: what was tested, at which error, and how many are decided."""
    assert space.sequential is not None
    decided = sum(each.outcome.state in ("better", "worse") for each in found)
    return (
        f"Sequential test over seeds (AdaStop), family-wise error {space.sequential.alpha:g} on each target: "
        f"{decided} of {len(found)} comparisons decided"
    )
