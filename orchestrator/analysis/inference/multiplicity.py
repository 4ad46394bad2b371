"""Many comparisons at once: p-values and intervals that hold for all of them together."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from orchestrator.analysis.statistics import LEVEL, Estimate


def holm(p_values: Sequence[float]) -> list[float]:
    """Return p-values corrected by Holm's step-down method, in their order.

    Rejecting those of at most alpha makes any false rejection at all in at most alpha of cases, whatever the
    dependence of the tests. S. Holm, "A simple sequentially rejective multiple test procedure", Scandinavian Journal
    of Statistics 6 (1979).
    """
    p: NDArray[np.float64] = np.asarray(p_values, dtype=np.float64)
    if not np.isfinite(p).all() or ((p < 0) | (p > 1)).any():
        raise ValueError(f"p-values lie between 0 and 1 (got {list(p_values)})")
    order = np.argsort(p, kind="stable")
    stepped = np.maximum.accumulate((len(p) - np.arange(len(p))) * p[order])
    corrected = np.empty_like(p)
    corrected[order] = np.minimum(stepped, 1.0)
    return [float(value) for value in corrected]


def simultaneous(estimate: Estimate, comparisons: int) -> tuple[float, float] | None:
    """Return Bonferroni's interval of one of several differences: all of them cover at once as often as LEVEL says.

    None for a difference without an interval.
    """
    if estimate.low is None or estimate.high is None or estimate.df is None:
        return None
    wider = stats.t.isf((1 - LEVEL) / (2 * comparisons), estimate.df) / stats.t.isf((1 - LEVEL) / 2, estimate.df)
    half = float(wider) * (estimate.high - estimate.low) / 2
    return estimate.value - half, estimate.value + half
