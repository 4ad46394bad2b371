"""Other uses of a source beside the paper's, and what of delta does the work."""

from __future__ import annotations

from collections.abc import Iterable

from benchmarks.reproduction.claims import DELTA_ES, DQN, ES, HEAVIER, HEAVY, LONG, LONGER, WARM_START, X5, X7, Arm
from benchmarks.reproduction.curves import Curves, difference, seeds
from benchmarks.reproduction.tables import interval, markdown, mean_sd, p_text
from orchestrator.analysis.inference.multiplicity import holm
from orchestrator.analysis.statistics import Estimate

TARGETS = (X5, X7, LONG, LONGER, HEAVY, HEAVIER)
FRESH = Arm("warm_start", (("last_layer", "fresh"),))
EXPLORING = Arm("dqn", (("epsilon_start", 0.3), ("epsilon_decay", 50.0)))
"""DQN with the exploration of a warm start, and nothing from a source."""
OTHERS = ("safe_start", "jsrl", "ppr_dqn", "kickstart", "replay_seed", "dqinit", "corrected_es", "relative_es")
ABLATIONS = ("constant_es", "shuffled_es")
ARMS = (EXPLORING, ES, DELTA_ES, WARM_START, FRESH, *(Arm(agent) for agent in (*OTHERS, *ABLATIONS)))
PAIRS = (
    (DELTA_ES, ES),
    *((DELTA_ES, Arm(agent)) for agent in ABLATIONS),
    (Arm("corrected_es"), DELTA_ES),
    (Arm("relative_es"), ES),
    (WARM_START, DELTA_ES),
)
"""What is compared beside dqn: the parts of Algorithm 2, and a warm start with it."""


def tables(curves: Curves) -> tuple[str, str]:
    """Return each agent against dqn, and PAIRS, both with Holm's correction over all of their comparisons of AUC."""
    against, beside = list(_against(curves)), list(_beside(curves))
    corrected = holm([1.0 if gap.p is None else gap.p for _, gap in (*against, *beside)])
    rows = [(*row, interval(gap), p_text(p)) for (row, gap), p in zip((*against, *beside), corrected, strict=True)]
    first, second = rows[: len(against)], rows[len(against) :]
    gap = "difference from dqn [95 %]"
    head = ("target", "agent", "seeds", "AUC (sd)", "early AUC", f"early {gap}", gap, "p, Holm")
    return (
        markdown(head, first) if first else "",
        markdown(("target", "comparison", "seeds", "difference [95 %]", "p, Holm"), second) if second else "",
    )


Row = tuple[tuple[object, ...], Estimate]
"""The fields of a row, and the difference that it is about."""


def _against(curves: Curves) -> Iterable[Row]:
    """Yield a row per target and agent, the largest difference from dqn first."""
    for target in TARGETS:
        rows: list[Row] = []
        for arm in ARMS:
            cells, both = curves.best(target, arm), curves.paired(target, arm, DQN)
            if (gap := difference(both)) is not None:
                early = f"{cells['early'].mean():.1f}", interval(difference(both, "early"))
                rows.append(((target, _name(arm), seeds(both), mean_sd(cells), *early), gap))
        yield from sorted(rows, key=lambda row: -row[1].value)


def _beside(curves: Curves) -> Iterable[Row]:
    for target in TARGETS:
        for first, second in PAIRS:
            both = curves.paired(target, first, second)
            if (gap := difference(both)) is not None:
                yield (target, f"{_name(first)} - {_name(second)}", seeds(both)), gap


def _name(arm: Arm) -> str:
    """Return the agent's name, with what is not its default."""
    return {FRESH: "warm_start, fresh last layer", EXPLORING: "dqn, explores as warm_start"}.get(arm, arm.agent)
