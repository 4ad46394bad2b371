"""The page's first part: what the published cells answer, in a few sentences."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from benchmarks.reproduction import safe
from benchmarks.reproduction.claims import DELTA_ES, DQN, ES, WARM_START, X5, X7, Arm, Claim
from benchmarks.reproduction.curves import Curves, Published, difference
from benchmarks.reproduction.safe import SAFE, Standings
from benchmarks.reproduction.tables import ROWS, interval
from benchmarks.reproduction.verdicts import ALPHA, Finding
from orchestrator.analysis.inference.multiplicity import holm
from orchestrator.analysis.statistics import Estimate

LEARNERS = (ES, DELTA_ES, WARM_START)

VERDICTS = (
    "confirmed",
    "confirmed before correction only",
    "undecided",
    "contradicted before correction",
    "contradicted before correction only",
    "contradicted",
    "not run",
)
"""All that a finding can have, in the order in which they are told."""


def sentences(parts: Published, found: Sequence[tuple[Claim, list[Finding]]], standings: Standings | None) -> list[str]:
    """Return the answers, each with the numbers that it stands on."""
    every = (_claims(found), _learners(parts.paper), _delta(parts.paper), _factor(parts.baselines))
    return [sentence for sentence in (*every, _safe(parts.safe, standings)) if sentence]


def _claims(found: Sequence[tuple[Claim, list[Finding]]]) -> str:
    """Return how many of the paper's comparisons came out how."""
    verdicts = list({each.comparison: each.verdict for _, all_of in found for each in all_of}.values())
    counted = ", ".join(f"{verdicts.count(word)} {word}" for word in sorted(set(verdicts), key=VERDICTS.index))
    return f"The paper's sentences make {len(verdicts)} comparisons: {counted}."


def _learners(curves: Curves) -> str:
    """Return on how many deep targets each agent is certain to be better or worse than dqn."""
    gaps = {(target, arm): difference(curves.paired(target, arm, DQN)) for target in ROWS for arm in LEARNERS}
    known = {place: gap for place, gap in gaps.items() if gap is not None and gap.p is not None}
    if not known:
        return ""
    sure, told = _sure(known.values()), []
    for arm in LEARNERS:
        signs = [gap.value > 0 for (_, each), gap in known.items() if each == arm and id(gap) in sure]
        told.append(f"`{arm.agent}` is better on {_count(signs.count(True))} and worse on {_count(signs.count(False))}")
    targets = len({target for target, _ in known})
    return (
        f"Against `dqn` on {targets} deep targets, after Holm's correction for these {len(known)} comparisons: "
        f"{', '.join(told)}."
    )


def _delta(curves: Curves) -> str:
    """Return whether the paper's factor improves on advice without it."""
    gaps = {target: difference(curves.paired(target, DELTA_ES, ES)) for target in ROWS}
    known = {target: gap for target, gap in gaps.items() if gap is not None and gap.p is not None}
    if not known:
        return ""
    sure = _sure(known.values())
    signs = [gap.value > 0 for gap in known.values() if id(gap) in sure]
    better, worse = _count(signs.count(True)), _count(signs.count(False))
    return (
        f"`delta_es` is better than `es`, the same advice without delta, on {better} of {len(known)} deep targets, and "
        f"worse on {worse}, after Holm's correction for {len(known)}."
    )


def _factor(curves: Curves) -> str:
    """Return what of delta's factor is more than its mean."""
    gaps = {target: difference(curves.paired(target, DELTA_ES, Arm("constant_es"))) for target in (X5, X7)}
    told = [f"{interval(gap)} on {target}" for target, gap in gaps.items() if gap is not None]
    what = "`delta_es` less `constant_es`, which has the mean of delta's factors in all states"
    return f"{what}: {', '.join(told)}." if told else ""


def _safe(curves: Curves, standings: Standings | None) -> str:
    """Return how the safe agent stands to dqn and delta_es."""
    if standings is None:
        return ""
    gaps = {task: difference(curves.paired(task, SAFE, DQN)) for task in standings.tasks}
    known = [gap for gap in gaps.values() if gap is not None and gap.p is not None]
    worse = sum(gap.value < 0 for gap in known if id(gap) in _sure(known))
    rivals = [arm for arm in (DQN, DELTA_ES, WARM_START) if arm.agent in standings.scores]
    told = [f"{interval(safe.gain(standings, curves, arm), 2)} for `{arm.agent}`" for arm in rivals]
    return (
        f"`safe_start` is worse than `dqn` on {_count(worse)} of {len(known)} targets, after Holm's correction for "
        f"{len(known)}. Its normalised AUC less that of others, as a mean over these targets: {', '.join(told)}."
    )


def _count(number: int) -> str:
    return str(number) if number else "none"


def _sure(gaps: Iterable[Estimate]) -> set[int]:
    """Return the identities of the differences that are certain after Holm's correction for all of them."""
    every = list(gaps)
    return {id(gap) for gap, p in zip(every, holm([gap.p or 0.0 for gap in every]), strict=True) if p < ALPHA}
