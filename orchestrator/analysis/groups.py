"""From cells to groups: one row per (task, agent, source, hyperparameters), over its seeds."""

from __future__ import annotations

import json
from collections.abc import Collection, Mapping
from dataclasses import dataclass, replace
from typing import Any, Literal

import pandas as pd

from orchestrator.analysis import statistics
from orchestrator.analysis.statistics import Estimate, TransferRatio
from orchestrator.planning.arms import Key
from trainables.agents.registry import agent_named
from trainables.plugins.names import short

Values = Mapping[str, Any]

Verdict = Literal["helped", "hurt", "undecided"]
"""What a comparison with the agent without transfer came to."""


@dataclass(frozen=True)
class Comparison:
    """A group with transfer against the group without, paired by the seeds that both have."""

    seeds: int
    transfer_ratio: TransferRatio
    difference: Estimate
    """A_t - A_w."""
    probability_of_improvement: Estimate
    jumpstart: Estimate
    """Difference of the first evaluations."""
    asymptotic: Estimate
    """Difference of the asymptotic performances."""

    @property
    def verdict(self) -> Verdict:
        """Whether transfer helped or hurt: the interval of the difference in AUC lies on one side of 0."""
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
    """Seeds that are done."""
    failed: int
    stopped: int
    """Cells that a scheduler has ended early; their AUC is of a shorter curve and compared with nothing."""
    missing: int
    auc: Estimate | None
    """Mean over seeds; None where no cell is done."""
    auc_sd: float | None
    auc_iqm: Estimate | None
    training_auc: Estimate | None
    asymptotic: Estimate | None
    max_abs_delta: Estimate | None
    """max |delta| at the end, as the agent estimated it."""
    against_base: Comparison | None
    """None for an agent without transfer, and where the one without transfer is not in the sweep."""
    pick: str = ""
    """Whose knowledge a seed got, where that is known."""
    source_label: str = ""
    """`source`, with the source task and the pick where the sweep has several for the task and agent."""

    @property
    def key(self) -> Key:
        """The arm that it is a configuration of."""
        return Key(self.task, self.agent, self.source_task or "", self.source, self.pick)

    @property
    def verdict(self) -> Verdict | None:
        """Its comparison's verdict; None where it is compared with nothing."""
        return self.against_base.verdict if self.against_base else None

    @property
    def complete(self) -> bool:
        """Whether every seed is done: only such a group is ever selected."""
        return bool(self.seeds) and not self.failed and not self.stopped and not self.missing


def groups(cells: pd.DataFrame) -> list[Group]:
    """The groups of a cells table, in its order."""
    if cells.empty:
        return []
    frames: dict[str, pd.DataFrame] = {str(key): frame for key, frame in cells.groupby("group", sort=False)}
    bases = {_base_key(frame.iloc[0]): frame for frame in frames.values() if frame.iloc[0]["source"] == "none"}
    found = [_group(key, frame, bases) for key, frame in frames.items()]
    arms = {group.key for group in found}
    return [replace(group, source_label=_source_label(group, arms)) for group in found]


def _source_label(group: Group, arms: Collection[Key]) -> str:
    """The kind of source, with what tells it from the others that the agent has on the task."""
    rivals = [key for key in arms if (key.task, key.agent, key.kind) == (group.task, group.agent, group.source)]
    text = group.source
    if group.source_task and len({key.source_task for key in rivals}) > 1:
        text += f" {'for' if group.source == 'none' else 'from'} {short(group.source_task)}"
    if group.pick and len({key.pick for key in rivals if key.source_task == group.source_task}) > 1:
        text += f", {group.pick}"
    return text


def _base_key(row: pd.Series, agent: str | None = None) -> tuple[str, str, str]:
    """(task, agent, hyperparameters): what a cell without transfer must share with a cell that is held against it."""
    name = agent or str(row["agent"])
    known = agent_named(name).hyperparameters.model_fields
    values = {key: value for key, value in json.loads(row["hyperparameters"]).items() if key in known}
    return str(row["task"]), name, json.dumps(values, sort_keys=True)


def _group(key: str, frame: pd.DataFrame, bases: Mapping[tuple[str, str, str], pd.DataFrame]) -> Group:
    first = frame.iloc[0]
    done = frame[frame["status"] == "done"]
    base = agent_named(str(first["agent"])).base
    without = bases.get(_base_key(first, base)) if base else None
    return Group(
        id=key,
        stage=str(first["stage"]),
        task=str(first["task"]),
        agent=str(first["agent"]),
        source=str(first["source"]),
        source_task=_text(first, "source_task") or _text(first, "baseline_for") or None,
        hyperparameters=json.loads(first["hyperparameters"]),
        seeds=tuple(int(seed) for seed in done["seed"]),
        failed=int((frame["status"] == "failed").sum()),
        stopped=int((frame["status"] == "stopped").sum()),
        missing=int((frame["status"] == "missing").sum()),
        auc=_mean(done, "auc"),
        auc_sd=statistics.sd(list(done["auc"])) if len(done) else None,
        auc_iqm=statistics.iqm(list(done["auc"])) if len(done) else None,
        training_auc=_mean(done, "training_auc"),
        asymptotic=_mean(done, "asymptotic"),
        max_abs_delta=_mean(done, "final_max_abs_delta"),
        against_base=_compare(done, without) if without is not None else None,
        pick=_text(first, "pick"),
    )


def _text(row: pd.Series, column: str) -> str:
    """What a column says; empty where it is empty or not there."""
    value = row.get(column)
    return value if isinstance(value, str) else ""


def _mean(done: pd.DataFrame, column: str) -> Estimate | None:
    if not len(done) or column not in done or done[column].isna().any():
        return None
    return statistics.mean(list(done[column]))


def _compare(done: pd.DataFrame, without: pd.DataFrame) -> Comparison | None:
    both = done.merge(without[without["status"] == "done"], on="seed", suffixes=("", "_base")).sort_values("seed")
    if both.empty:
        return None

    def paired(column: str) -> Estimate:
        return statistics.difference(list(both[column]), list(both[f"{column}_base"]))

    a_t, a_w = list(both["auc"]), list(both["auc_base"])
    return Comparison(
        seeds=len(both),
        transfer_ratio=statistics.transfer_ratio(a_t, a_w),
        difference=paired("auc"),
        probability_of_improvement=statistics.probability_of_improvement(a_t, a_w),
        jumpstart=paired("initial_return"),
        asymptotic=paired("asymptotic"),
    )
