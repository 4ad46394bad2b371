"""The paired contrast of two configurations on one target, and a sweep's family of them, corrected together."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations
from typing import Literal

import pandas as pd

from orchestrator.analysis.curves import milestones
from orchestrator.analysis.groups import Corrected, Group
from orchestrator.analysis.inference.multiplicity import holm, simultaneous
from orchestrator.analysis.inference.pairs import difference, paired
from orchestrator.analysis.statistics import Estimate
from trainables.agents.registry import agent_named

Verdict = Literal["better", "worse", "undecided"]

Measure = Literal["auc", "early_auc"]
"""What is compared: the AUC of the whole run, or that until the advice ends."""

Pairs = Sequence[tuple[str, str]]
"""Agents whose contrasts are asked for: A - B each."""


@dataclass(frozen=True)
class Contrast:
    """A - B on one target, paired by seed, and by source network where both are crossed with several."""

    first: Group
    """A."""
    second: Group
    """B."""
    seeds: int
    difference: Estimate
    """In `measure`, A - B, with its p-value."""
    measure: Measure = "auc"
    early: Estimate | None = None
    """In the AUC until the advice ends; None where neither has advice, nor another agent on the target."""
    corrected: Corrected | None = None
    """The same among all contrasts that are shown with it; None where there are too few seeds for a test."""

    @property
    def name(self) -> str:
        """'delta_es - es'."""
        return f"{self.first.agent} - {self.second.agent}"

    @property
    def verdict(self) -> Verdict:
        """Whether A is better or worse than B: the plain interval lies on one side of 0."""
        low, high = self.difference.low, self.difference.high
        if low is None or high is None or low <= 0 <= high:
            return "undecided"
        return "better" if low > 0 else "worse"

    @property
    def verdict_text(self) -> str:
        """The verdict, and whether it holds after the correction for all contrasts that are shown with it."""
        if self.verdict == "undecided" or (self.corrected and self.corrected.holds):
            return self.verdict
        return f"{self.verdict} (Holm: undecided)"


def of_interest(names: Iterable[str]) -> list[tuple[str, str]]:
    """Return the pairs of agents that are shown where nobody asks: each agent against those that it builds on.

    The agent without transfer comes last: delta_es - es, then delta_es - dqn and es - dqn.
    """
    agents = list(dict.fromkeys(names))
    rivals = [(agent, rival) for agent in agents for rival in agent_named(agent).rivals if rival in agents]
    bases = [(agent, base) for agent in agents if (base := agent_named(agent).base) in agents and base is not None]
    return [*rivals, *bases]


def every_pair(names: Iterable[str]) -> list[tuple[str, str]]:
    """Return each pair of agents once: those of interest as they are, the rest with the later agent first."""
    agents = list(dict.fromkeys(names))
    chosen = of_interest(agents)
    known = {frozenset(pair) for pair in chosen}
    return [*chosen, *((b, a) for a, b in combinations(agents, 2) if frozenset((a, b)) not in known)]


def contrasts(
    best: Sequence[Group],
    groups: Sequence[Group],
    cells: pd.DataFrame,
    pairs: Pairs | None = None,
    measure: Measure = "auc",
) -> list[Contrast]:
    """Return the contrasts of the best configurations on each target, corrected for how many they are.

    best: a configuration of each arm. pairs: default `of_interest`. An agent against its base is the comparison that
    its verdict comes from, at the same hyperparameters; other pairs are of the best configurations, with the same
    source task, kind of source and pick where both have a source.
    """
    by_id = {group.id: group for group in groups}
    done = cells[cells["status"] == "done"] if len(cells) else cells
    frames = {str(name): frame for name, frame in done.groupby("group")} if len(done) else {}
    found = []
    for agents in of_interest(group.agent for group in best) if pairs is None else pairs:
        for first in (group for group in best if group.agent == agents[0]):
            for second in _opponents(first, agents[1], best, by_id):
                contrast = _contrast(first, second, frames, measure)
                found += [contrast] if contrast else []
    return corrected(found)


def _opponents(first: Group, agent: str, best: Sequence[Group], by_id: Mapping[str, Group]) -> list[Group]:
    """Return the configurations of an agent that a configuration is held against."""
    if first.against_base is not None and agent_named(first.agent).base == agent:
        return [by_id[first.base_id]]
    here = [group for group in best if (group.task, group.agent) == (first.task, agent) and group is not first]
    if first.source == "none":
        return [group for group in here if group.source == "none" or first.source_task in (None, group.source_task)]
    same = [group for group in here if group.source != "none" and group.key[2:] == first.key[2:]]
    return same or [
        group for group in here if group.source == "none" and group.source_task in (None, first.source_task)
    ]


def _contrast(first: Group, second: Group, frames: Mapping[str, pd.DataFrame], measure: Measure) -> Contrast | None:
    """Return a contrast not yet corrected; None where the two share no seed."""
    if not {first.id, second.id} <= frames.keys():
        return None
    both = paired(frames[first.id], frames[second.id])
    both = both if both.empty else milestones.aligned(both)
    gap, early = difference(both, measure), difference(both, milestones.EARLY)
    return None if gap is None else Contrast(first, second, int(both["seed"].nunique()), gap, measure, early)


def corrected(found: Sequence[Contrast]) -> list[Contrast]:
    """Return contrasts corrected for how many of them are tested: Holm's p-values, Bonferroni's intervals."""
    tested = [contrast for contrast in found if contrast.difference.p is not None]
    p_values = iter(holm([contrast.difference.p or 0.0 for contrast in tested]))
    done = []
    for contrast in found:
        ends = simultaneous(contrast.difference, len(tested))
        one = None if ends is None else Corrected(len(tested), next(p_values), *ends)
        done.append(replace(contrast, corrected=one))
    return done
