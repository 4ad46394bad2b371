"""The page's first part: what the published cells answer, in a few sentences."""

from __future__ import annotations

from collections.abc import Hashable, Mapping, Sequence
from typing import TypeVar

import numpy as np

from benchmarks.reproduction.claims import DELTA_ES, DQN, ES, MARGIN, WARM_START, Arm, Claim
from benchmarks.reproduction.curves import Curves, Published, difference
from benchmarks.reproduction.mean_gain import mean_gain
from benchmarks.reproduction.others import TARGETS
from benchmarks.reproduction.safe import SAFE, Standings
from benchmarks.reproduction.tables import ROWS, interval
from benchmarks.reproduction.verdicts import ALPHA, Finding, counted, no_worse
from orchestrator.analysis.inference.multiplicity import holm
from orchestrator.analysis.statistics import Estimate

Key = TypeVar("Key", bound=Hashable)

LEARNERS = (ES, DELTA_ES, WARM_START)


def sentences(parts: Published, found: Sequence[tuple[Claim, list[Finding]]], standings: Standings | None) -> list[str]:
    """Return the answers, each with the numbers that it stands on."""
    every = (_claims(found), _learners(parts.paper), _delta(parts.paper), _factor(parts.baselines))
    return [sentence for sentence in (*every, _safe(parts.safe, standings)) if sentence]


def _claims(found: Sequence[tuple[Claim, list[Finding]]]) -> str:
    """Return how many of the paper's comparisons came out how."""
    all_of = list({each.comparison: each for _, findings in found for each in findings}.values())
    return f"The paper's sentences make {len(all_of)} comparisons: {counted(all_of)}."


def _learners(curves: Curves) -> str:
    """Return on how many deep targets each agent is certain to be better or worse than dqn."""
    signs = _signs({(target, arm): difference(curves.paired(target, arm, DQN)) for target in ROWS for arm in LEARNERS})
    if not signs:
        return ""
    told = []
    for arm in LEARNERS:
        mine = [sign for (_, each), sign in signs.items() if each == arm]
        told.append(f"`{arm.agent}` is better on {_count(mine, 1)} of {len(mine)} and worse on {_count(mine, -1)}")
    return f"Against `dqn` on deep targets, after Holm's correction for {len(signs)} comparisons: {', '.join(told)}."


def _delta(curves: Curves) -> str:
    """Return whether the paper's factor improves on advice without it."""
    found = _signs({target: difference(curves.paired(target, DELTA_ES, ES)) for target in ROWS})
    signs = list(found.values())
    if not signs:
        return ""
    return (
        f"`delta_es` is better than `es`, the same advice without delta, on {_count(signs, 1)} of {len(signs)} deep "
        f"targets, and worse on {_count(signs, -1)}, after Holm's correction for {len(signs)}. Its normalised AUC less "
        f"that of `es`, as a mean over these targets: {interval(mean_gain(curves, list(found), DELTA_ES, ES))}."
    )


def _factor(curves: Curves) -> str:
    """Return what of delta's factor is more than its mean."""
    gaps = {target: difference(curves.paired(target, DELTA_ES, Arm("constant_es"))) for target in TARGETS}
    told = [f"{interval(gap)} on {target}" for target, gap in gaps.items() if gap is not None]
    what = "`delta_es` less `constant_es`, which has the mean of delta's factors in all states"
    return f"{what}: {', '.join(told)}." if told else ""


def _safe(curves: Curves, standings: Standings | None) -> str:
    """Return how the safe agent stands to dqn and delta_es."""
    if standings is None:
        return ""
    beside = {task: curves.paired(task, SAFE, DQN) for task in standings.tasks}
    signs = list(_signs({task: difference(both) for task, both in beside.items()}).values())
    losses = [p for p in map(no_worse, beside.values()) if p is not None]
    shown = sum(p < ALPHA for p in holm(losses))
    rivals = [arm for arm in (DQN, DELTA_ES, WARM_START) if arm.agent in standings.scores]
    told = [f"{interval(mean_gain(curves, standings.tasks, SAFE, arm))} for `{arm.agent}`" for arm in rivals]
    return (
        f"`safe_start` is worse than `dqn` on {_count(signs, -1)} of {len(signs)} targets, and shown to lose less than "
        f"{MARGIN:.0%} on {shown} of them (one-sided), each after Holm's correction for {len(signs)}. Its normalised "
        f"AUC less that of others, as a mean over these targets: {', '.join(told)}."
    )


def _count(signs: Sequence[int], sign: int) -> str:
    return str(signs.count(sign)) if sign in signs else "none"


def _signs(gaps: Mapping[Key, Estimate | None]) -> dict[Key, int]:
    """Return 1 or -1 for each difference that is certain after Holm's correction for all of them, else 0."""
    known = {key: (gap.value, gap.p) for key, gap in gaps.items() if gap is not None and gap.p is not None}
    corrected = holm([p for _, p in known.values()])
    return {
        key: int(np.sign(value)) if p < ALPHA else 0
        for (key, (value, _)), p in zip(known.items(), corrected, strict=True)
    }
