"""Groups: the configurations of a sweep, each (task, agent, source, hyperparameters) over its seeds."""

from __future__ import annotations

import json
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal

import pandas as pd

from orchestrator.analysis.curves import milestones
from orchestrator.analysis.curves.learning import nothing_in
from orchestrator.analysis.inference.pairs import paired
from orchestrator.analysis.inference.seeds import Seeds, networks, whole_seeds
from orchestrator.analysis.metrics import DIFFERENCE, METRICS, TRANSFER_RATIO
from orchestrator.analysis.statistics import LEVEL, Estimate, TransferRatio
from orchestrator.planning.arms import Key
from trainables.agents.registry import agent_named
from trainables.plugins.names import short

Values = Mapping[str, Any]

Verdict = Literal["helped", "hurt", "undecided"]
"""The result of a comparison with the agent without transfer."""


@dataclass(frozen=True)
class Corrected:
    """A comparison as one of several that are made at once."""

    comparisons: int
    """How many are made at once."""
    p: float
    """The p-value after Holm's correction for all of them."""
    low: float
    """Bonferroni's interval of the difference: all of them cover at once."""
    high: float

    @property
    def holds(self) -> bool:
        """Whether the difference stands after the correction."""
        return self.p <= 1 - LEVEL


@dataclass(frozen=True)
class Comparison:
    """A group with transfer compared with the group without, paired by the seeds that both have."""

    seeds: int
    transfer_ratio: TransferRatio
    difference: Estimate
    """A_t - A_w."""

    @property
    def verdict(self) -> Verdict:
        """The verdict: helped or hurt where the interval of the difference lies on one side of 0, else undecided."""
        low, high = self.difference.low, self.difference.high
        if low is None or high is None or low <= 0 <= high:
            return "undecided"
        return "helped" if low > 0 else "hurt"


@dataclass(frozen=True)
class Group:
    """The cells that differ in nothing but the seed."""

    id: str
    stage: str
    task: str
    agent: str
    source: str
    """learned, exact or none."""
    source_task: str | None
    hyperparameters: Values
    seeds: tuple[int, ...]
    """Seeds that are done; of several source networks, with all of them."""
    failed: int
    stopped: int
    """Cells that a scheduler has stopped early; their curves are shorter, so their AUC is compared with no other."""
    missing: int
    estimates: Mapping[str, Estimate | TransferRatio]
    """Metric.key to its estimate over seeds; metrics without data are left out."""
    against_base: Comparison | None
    """None for an agent without transfer, and where the sweep has no agent without transfer to compare with."""
    nothing: str | None = None
    """A sentence if an agent without transfer learned nothing, else None."""
    pick: str = ""
    """Which source's knowledge a seed got (own_seed, best_evaluated, each or a seed); empty where that is not known."""
    networks: int = 1
    """Source networks that every seed is crossed with (pick: each): then both are random in means and differences."""
    sources: int = 0
    """Source networks that its seeds had in all; 1 for an exact source."""
    base_id: str = ""
    """The group without transfer that it is compared with; empty where there is none."""
    confirmed: Group | None = None
    """The same configuration on unseen seeds, of a selected one that was confirmed."""
    corrected: Corrected | None = None
    """The comparison with the agent without transfer, corrected for all comparisons of the sweep; None outside them."""
    tried: int = 1
    """Number of configurations it was chosen from by the seeds that judge it; 1 where it was not chosen."""
    tuned: frozenset[str] = frozenset()
    """Hyperparameters in which the configurations of its arm differ."""
    source_label: str = ""
    """`source`, with source task and pick where the sweep has several sources for the task and agent."""

    @property
    def key(self) -> Key:
        """The key of its arm."""
        return Key(self.task, self.agent, self.source_task or "", self.source, self.pick)

    @property
    def judged(self) -> Group:
        """What the configuration is judged by: its confirmation where there is one, else itself."""
        return self.confirmed or self

    @property
    def auc(self) -> Estimate | None:
        """The mean AUC over seeds with its sd; None where no cell is done."""
        return self.estimate("auc")

    def estimate(self, key: str) -> Estimate | None:
        """Return the estimate of a metric, or None."""
        found = self.estimates.get(key)
        return found if isinstance(found, Estimate) else None

    @property
    def verdict(self) -> Verdict | None:
        """The verdict of its comparison; None without a comparison."""
        return self.against_base.verdict if self.against_base else None

    @property
    def verdict_text(self) -> str | None:
        """The verdict, and whether it holds after the correction for all comparisons of the sweep."""
        verdict = self.verdict
        if verdict in (None, "undecided"):
            return verdict
        if self.corrected is None:
            return f"{verdict} (uncorrected)"
        return str(verdict) if self.corrected.holds else f"{verdict} (Holm: undecided)"

    @property
    def complete(self) -> bool:
        """Whether every seed is done; only complete groups are selected."""
        return bool(self.seeds) and not self.failed and not self.stopped and not self.missing


def groups(cells: pd.DataFrame) -> list[Group]:
    """Return the groups of a cells table, in its order."""
    if cells.empty:
        return []
    frames: dict[str, pd.DataFrame] = {str(key): frame for key, frame in cells.groupby("group", sort=False)}
    values = {key: json.loads(frame.iloc[0]["hyperparameters"]) for key, frame in frames.items()}
    bases = {
        _base_key(first, values[key], str(first["agent"])): frame
        for key, frame in frames.items()
        if (first := frame.iloc[0])["source"] == "none"
    }
    found = [_group(key, frame, values[key], bases) for key, frame in frames.items()]
    arms: dict[Key, list[Values]] = {}
    for group in found:
        arms.setdefault(group.key, []).append(group.hyperparameters)
    tuned = {key: _differing(every) for key, every in arms.items()}
    return [replace(group, source_label=_source_label(group, arms), tuned=tuned[group.key]) for group in found]


def _differing(every: Sequence[Values]) -> frozenset[str]:
    """Return the names whose values are not the same everywhere."""
    return frozenset(name for name, value in every[0].items() if any(other.get(name) != value for other in every))


def _source_label(group: Group, arms: Collection[Key]) -> str:
    """Return the kind of source, with what distinguishes it from the agent's other sources on the task."""
    rivals = [key for key in arms if (key.task, key.agent, key.kind) == (group.task, group.agent, group.source)]
    text = group.source
    if group.source_task and len({key.source_task for key in rivals}) > 1:
        text += f" {'for' if group.source == 'none' else 'from'} {short(group.source_task)}"
    if group.pick and len({key.pick for key in rivals if key.source_task == group.source_task}) > 1:
        text += f", {group.pick}"
    return text


def _base_key(row: pd.Series, values: Values, agent: str) -> tuple[str, str, str]:
    """Return (task, agent, hyperparameters), in which a cell and its baseline, of that agent, must agree."""
    known = agent_named(agent).hyperparameters.model_fields
    shared = {key: value for key, value in values.items() if key in known}
    return str(row["task"]), agent, json.dumps(shared, sort_keys=True)


def _group(key: str, frame: pd.DataFrame, values: Values, bases: Mapping[tuple[str, str, str], pd.DataFrame]) -> Group:
    first = frame.iloc[0]
    done = whole_seeds(frame)
    base = agent_named(str(first["agent"])).base
    without = bases.get(_base_key(first, values, base)) if base else None
    both = _paired(done, without)
    found = {metric.key: metric.compute(Seeds(done, both)) for metric in METRICS}
    estimates = {name: estimate for name, estimate in found.items() if estimate is not None}
    return Group(
        id=key,
        stage=str(first["stage"]),
        task=str(first["task"]),
        agent=str(first["agent"]),
        source=str(first["source"]),
        source_task=_text(first, "source_task") or _text(first, "baseline_for") or None,
        hyperparameters=values,
        seeds=tuple(int(seed) for seed in done["seed"].drop_duplicates()),
        failed=int((frame["status"] == "failed").sum()),
        stopped=int((frame["status"] == "stopped").sum()),
        missing=int((frame["status"] == "missing").sum()),
        estimates=estimates,
        against_base=_comparison(estimates, both),
        nothing=nothing_in(done) if first["source"] == "none" else None,
        pick=_text(first, "pick"),
        networks=networks(frame),
        base_id=str(without.iloc[0]["group"]) if without is not None else "",
        sources=_sources(done),
    )


def _sources(done: pd.DataFrame) -> int:
    """Return how many source networks the cells had: 1 where all have the exact source, 0 without one."""
    learned = done["source_cell"].nunique() if "source_cell" in done else 0
    return int(learned or (len(done) and (done["source"] != "none").any()))


def _text(row: pd.Series, column: str) -> str:
    """Return a column's text; empty where it is empty or missing."""
    value = row.get(column)
    return value if isinstance(value, str) else ""


def _paired(done: pd.DataFrame, without: pd.DataFrame | None) -> pd.DataFrame | None:
    """Return the done cells joined by seed with those of the agent without transfer; None where there are none."""
    if without is None:
        return None
    both = paired(done, whole_seeds(without))
    return None if both.empty else milestones.aligned(both)


def _comparison(estimates: Mapping[str, Estimate | TransferRatio], both: pd.DataFrame | None) -> Comparison | None:
    ratio, difference = estimates.get(TRANSFER_RATIO.key), estimates.get(DIFFERENCE.key)
    if both is None or not isinstance(ratio, TransferRatio) or not isinstance(difference, Estimate):
        return None
    return Comparison(int(both["seed"].nunique()), ratio, difference)
