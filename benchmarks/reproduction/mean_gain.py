"""How much better one agent is than another over several targets, on the scale of normalised returns."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache

import numpy as np

from benchmarks.reproduction.claims import Arm
from benchmarks.reproduction.curves import Curves
from orchestrator.analysis.inference import crossed
from orchestrator.analysis.over_tasks import reference
from orchestrator.analysis.statistics import Estimate, tested
from search_spaces.loading import load
from trainables.tasks.registry import parse_task


@cache
def references(target: str) -> tuple[float, float]:
    """Return the returns of a random policy and of a solution."""
    found = reference(parse_task(target).name, load("reproduction").normalise)
    assert found is not None
    return found


def mean_gain(curves: Curves, targets: Sequence[str], first: Arm, second: Arm) -> Estimate:
    """Return the first agent's normalised AUC less the second's, paired by seed: the mean over targets.

    By Student's t, the standard errors of the targets put together with Satterthwaite's degrees of freedom.
    """
    gaps = [_gaps(curves, target, first, second) for target in targets]
    errors = [crossed.standard_error(each) for each in gaps]
    variances = np.array([(error or 0.0) ** 2 for error, _ in errors])
    freedom = variances.sum() ** 2 / sum(part**2 / df for part, (_, df) in zip(variances, errors, strict=True))
    value = float(np.mean([each.mean() for each in gaps]))
    return tested(value, float(np.sqrt(variances.sum())) / len(gaps), float(freedom))


def _gaps(curves: Curves, target: str, first: Arm, second: Arm) -> crossed.Table:
    both = curves.paired(target, first, second)
    gaps = both.assign(gap=both["auc"] - both["auc_base"])
    return crossed.rectangle(gaps.reindex(columns=[*crossed.BY, "gap"]), "gap") / float(np.ptp(references(target)))
