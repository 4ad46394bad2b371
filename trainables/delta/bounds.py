"""Theorems 1 and 3 of the paper, computed on a pair of tabular tasks."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from trainables.delta.exact import exact_delta, exact_q, policy_q
from trainables.errors import InputError
from trainables.tasks.registry import model_of, parse_task

ROUNDING = 1e-9
"""Tolerance of the inequalities; the values are exact to about 1e-11."""


@dataclass(frozen=True)
class Bounds:
    """Exact values for one transfer scenario, discounted by gamma."""

    source: str
    target: str
    gamma: float
    max_abs_delta: float
    """max over (s,a) of |delta(s,a)|."""
    task_distance: float
    """Delta(M_src, M_trg) = max over (s,a) of |Q*_src - Q*_trg|."""
    theorem1_bound: float
    """max |delta| / (1 - gamma)."""
    v_source: float
    """V*_src at the start state."""
    v_target: float
    """V*_trg at the start state."""
    theorem1_holds: bool
    theorem3_holds: bool
    theorem3_slack: float
    """The smallest distance of Q_trg^pi - Q_src^pi from its two bounds, over (s,a) and both sides."""


def bounds(source: str, target: str, gamma: float = 0.99) -> Bounds:
    """Return the bounds for the tasks called `source` and `target`.

    Raises InputError where a task is not tabular, where the two do not share states and actions, or gamma is
    not in [0, 1).
    """
    if not 0 <= gamma < 1:
        raise InputError(f"gamma must be at least 0 and less than 1 (got {gamma})")
    source, target = parse_task(source).name, parse_task(target).name
    src, trg = model_of(source), model_of(target)
    if src.rewards.shape != trg.rewards.shape:
        raise InputError(
            f"{source} and {target} do not share states and actions: {src.rewards.shape} and {trg.rewards.shape}"
        )
    q_src, q_trg = exact_q(source, gamma), exact_q(target, gamma)
    live = ~trg.terminal
    delta = exact_delta(trg, q_src, gamma)
    largest = float(np.max(np.abs(delta)))
    distance = float(np.max(np.abs(q_src - q_trg)[live]))
    slack = _theorem3_slack(source, target, gamma)
    return Bounds(
        source=source,
        target=target,
        gamma=gamma,
        max_abs_delta=largest,
        task_distance=distance,
        theorem1_bound=largest / (1 - gamma),
        v_source=float(q_src[src.start].max()),
        v_target=float(q_trg[trg.start].max()),
        theorem1_holds=distance <= largest / (1 - gamma) + ROUNDING,
        theorem3_holds=slack >= -ROUNDING,
        theorem3_slack=slack,
    )


def _theorem3_slack(source: str, target: str, gamma: float) -> float:
    """Return how far Q_trg^pi - Q_src^pi stays inside Theorem 3's bounds, for pi = the source's optimal policy."""
    trg = model_of(target)
    live = ~trg.terminal
    q_src = exact_q(source, gamma)
    policy = q_src.argmax(axis=1)
    delta = exact_delta(trg, q_src, gamma, policy)[live]
    difference = (policy_q(trg, policy, gamma) - q_src)[live]
    factor = gamma / (1 - gamma)
    # An episode that ends has delta 0 from then on, so 0 belongs to the range of delta.
    low = delta + factor * min(float(delta.min()), 0.0 if trg.terminal.any() else np.inf)
    high = delta + factor * max(float(delta.max()), 0.0 if trg.terminal.any() else -np.inf)
    return float(min((difference - low).min(), (high - difference).min()))
