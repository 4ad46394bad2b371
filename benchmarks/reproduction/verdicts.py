"""A verdict on every comparison of every claim, corrected for how many there are."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import pandas as pd

from benchmarks.reproduction.claims import CLAIMS, MARGIN, SHARES, Arm, Claim, Comparison
from benchmarks.reproduction.curves import Curves, difference, seeds
from orchestrator.analysis import statistics
from orchestrator.analysis.inference.multiplicity import holm
from orchestrator.analysis.statistics import Estimate

ALPHA = 1 - statistics.LEVEL

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


@dataclass(frozen=True)
class Finding:
    """What the published cells say of one comparison."""

    comparison: Comparison
    seeds: int
    difference: Estimate | None
    """First minus second, paired by seed and source network; None where there are fewer than two seeds."""
    p: float | None
    """Two-sided, of Student's paired test of no difference; for 'no worse' the one-sided one of a loss of MARGIN."""
    corrected: float | None = None
    """After Holm, over all comparisons that were run."""

    @property
    def verdict(self) -> str:
        """Confirmed, confirmed before correction only, contradicted, undecided, or not run."""
        if self.difference is None or self.p is None or self.corrected is None:
            return "not run"
        above = self.difference.value > 0
        if self.comparison.kind == "no worse":
            if self.p < ALPHA:
                return "confirmed" if self.corrected < ALPHA else "confirmed before correction only"
            return "contradicted before correction" if (self.difference.high or 0) < 0 else "undecided"
        word = "confirmed" if above else "contradicted"
        if self.corrected < ALPHA:
            return word
        return f"{word} before correction only" if self.p < ALPHA else "undecided"


def counted(found: Sequence[Finding]) -> str:
    """Return how many findings came out how: '2 confirmed, 1 undecided'."""
    verdicts = [finding.verdict for finding in found]
    return ", ".join(f"{verdicts.count(word)} {word}" for word in VERDICTS if word in verdicts)


def findings(curves: Curves, shares: Curves, claims: Sequence[Claim] = CLAIMS) -> list[tuple[Claim, list[Finding]]]:
    """Return each claim with its findings, p-values corrected over all; one that two claims share counts once.

    shares: the cells of Figure 4.
    """
    plain = {part: _find(shares if part.shares else curves, part) for claim in claims for part in claim.parts}
    run = [part for part, finding in plain.items() if finding.p is not None]
    corrected = dict(zip(run, holm([plain[part].p or 0.0 for part in run]), strict=True))
    return [(claim, [replace(plain[part], corrected=corrected.get(part)) for part in claim.parts]) for claim in claims]


def _find(curves: Curves, part: Comparison) -> Finding:
    both = _paired(curves, part)
    gap = difference(both, part.column)
    if gap is None:
        return Finding(part, seeds(both), None, None)
    p = no_worse(both, part.column) if part.kind == "no worse" else gap.p
    return Finding(part, seeds(both), gap, p)


def _paired(curves: Curves, part: Comparison) -> pd.DataFrame:
    """Return the statistic of both, a row per pair: of cells, or of source networks, which take the seeds' place."""
    if part.column in ("auc", "first_tenth"):
        return curves.paired(part.target, part.better, part.worse)
    first, second = (spreads(curves, part.target, arm, part.column) for arm in (part.better, part.worse))
    both = pd.DataFrame({part.column: first, f"{part.column}_base": second}).dropna()
    return both.assign(seed=range(len(both)), source_cell=None)


def spreads(curves: Curves, target: str, arm: Arm, column: str) -> pd.Series[float]:
    """Return the range of an arm's means over SHARES, or the logarithm of its variance, by source network."""
    cells = [curves.best(target, replace(arm, settings=(("advice_fraction", at),))) for at in SHARES]
    if any(each.empty for each in cells):
        return pd.Series(dtype=float)
    aucs = [each.groupby("source_cell")["auc"] for each in cells]
    if column == "range":
        means = pd.concat([each.mean() for each in aucs], axis=1)
        return means.max(axis=1) - means.min(axis=1)
    return pd.concat([np.log(each.var()) for each in aucs], axis=1).mean(axis=1)


def no_worse(both: pd.DataFrame, column: str = "auc") -> float | None:
    """Return the one-sided p-value that the first loses MARGIN of the second's mean, or more."""
    loss = MARGIN * abs(float(both[f"{column}_base"].mean()))
    over = difference(both, column, loss)
    return None if over is None or over.p is None else over.p / 2 if over.value > 0 else 1 - over.p / 2
