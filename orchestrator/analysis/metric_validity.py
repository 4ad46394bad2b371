"""Which measure of similarity predicts transfer: measures of task pairs, and their rank correlation with the effect."""

from __future__ import annotations

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from orchestrator.analysis.groups import Group, groups
from orchestrator.analysis.statistics import Estimate, rank_correlation
from trainables.delta import bisimulation
from trainables.delta.bounds import bounds
from trainables.delta.exact import exact_delta, exact_q, policy_q
from trainables.errors import InputError
from trainables.tasks.registry import model_of

Measures = dict[str, float | None]

NAMES = {
    "max_delta": "max |delta|, exact",
    "path_rms_delta": "delta on its path, exact",
    "path_delta": "path delta, exact",
    "learned_max_delta": "max |delta|, learned",
    "task_distance": "Delta(M_src, M_trg)",
    "reuse_gain": "reuse gain",
    "bisimulation": "bisimulation, upper bound",
}
"""Every measure with its label."""

NEARNESS = ("path_delta", "reuse_gain")
"""Measures that are large for similar tasks; the others are distances."""


def measures(source: str, target: str, gamma: float) -> Measures:
    """The exact measures of a pair of tabular tasks; None for bisimulation where there are too many states."""
    q_src, trg = exact_q(source, gamma), model_of(target)
    policy = q_src.argmax(axis=1)
    delta = exact_delta(trg, q_src, gamma)[np.arange(len(policy)), policy]
    weight = _occupancy(target, policy, gamma)
    both = bounds(source, target, gamma)
    try:
        distance: float | None = bisimulation.start_distance(source, target, gamma)
    except InputError:
        distance = None
    return {
        "max_delta": both.max_abs_delta,
        "path_rms_delta": float(np.sqrt(weight @ delta**2 / weight.sum())),
        "path_delta": float(policy_q(trg, policy, gamma)[trg.start, policy[trg.start]] - both.v_source),
        "task_distance": both.task_distance,
        "bisimulation": distance,
    }


def _occupancy(task: str, policy: NDArray[np.int64], gamma: float) -> NDArray[np.float64]:
    """Return the policy's discounted visits (S,) within the time limit."""
    model = model_of(task)
    rows = model.transitions[np.arange(len(policy)) * model.rewards.shape[1] + policy].T.tocsr()
    now = np.zeros(len(policy))
    now[model.start] = 1.0
    total = np.zeros(len(policy))
    for _ in range(model.time_limit):
        total += now
        now = gamma * (rows @ now)
    return total


def table(cells: pd.DataFrame) -> pd.DataFrame:
    """Return a row per source, target and agent of a sweep's cells table: every measure, and the transfer ratio."""
    rows = []
    every = groups(cells)
    reuse = {
        (group.source_task, group.task): group for group in every if group.agent == "policy_reuse" and group.complete
    }
    known: dict[tuple[str, str], Measures] = {}
    for group in every:
        if group.against_base is None or group.source_task is None or not group.complete:
            continue
        pair = group.source_task, group.task
        if pair not in known:
            known[pair] = measures(*pair, float(group.hyperparameters["gamma"]))
        rows.append(_row(group, known[pair], reuse.get(pair)))
    return pd.DataFrame(rows)


def _row(group: Group, found: Measures, reuse: Group | None) -> dict[str, object]:
    """Return a row with the learned delta and the gain of direct reuse of the sweep's own sources."""
    seen = {
        "learned_max_delta": learned.value if reuse and (learned := reuse.estimate("max_abs_delta")) else None,
        "reuse_gain": reuse.auc.value if reuse and reuse.auc else None,
    }
    assert group.against_base is not None
    ratio = group.against_base.transfer_ratio.value
    configuration = f"{group.agent} {group.hyperparameters.get('threshold', '')}".strip()
    return {"source": group.source_task, "target": group.task, "agent": configuration, "ratio": ratio, **found, **seen}


def correlations(pairs: pd.DataFrame) -> dict[tuple[str, str, str], Estimate]:
    """Return (source task, agent, measure) to the rank correlation of nearness with the transfer ratio.

    A measure that is constant over targets, or has fewer than three of them, is left out.
    """
    found = {}
    for (source, agent), rows in pairs.dropna(subset=["ratio"]).groupby(["source", "agent"], sort=False):
        for name in NAMES:
            values = rows[[name, "ratio"]].dropna() if name in rows else rows.iloc[:0]
            sign = 1.0 if name in NEARNESS else -1.0
            rho = rank_correlation(list(sign * values[name]), list(values["ratio"])) if len(values) else None
            if rho is not None:
                found[str(source), str(agent), name] = rho
    return found
