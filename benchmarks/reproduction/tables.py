"""The tables of docs/reproduction.md, as Markdown."""

from __future__ import annotations

import functools
import math
from collections.abc import Iterable, Sequence

import pandas as pd

from benchmarks.reproduction.claims import (
    DEMANDS,
    DQN,
    GATE,
    MARGIN,
    PPR,
    REUSE,
    REVERSED,
    SMALL,
    SUPPLY_GATE,
    Arm,
    Claim,
    Q,
)
from benchmarks.reproduction.curves import Curves, difference, seeds, transfer_ratio
from benchmarks.reproduction.verdicts import Finding, counted
from orchestrator.analysis import statistics
from orchestrator.analysis.statistics import Estimate
from orchestrator.analysis.tables.paper_table1 import AGENTS, TABLE_1
from orchestrator.markdown import table
from trainables.delta.bounds import bounds

exact = functools.cache(bounds)

ROWS = (*TABLE_1, "lunar_lander:mass=1.5")
"""The eight targets of Table 1, and the one that the appendix names in addition."""

PLANNED = {"cartpole": 20, "acrobot": 10, "lunar_lander": 10, "reacher": 10}
"""Seeds that this page is to have, by task."""

STATISTICS = {
    "auc": "",
    "first_tenth": " in the first tenth",
    "range": " in the range over shares of advice, per source network",
    "log_variance": " in the logarithm of the variance over seeds, per source network",
}
"""What a comparison is of, as the page says it."""

TUNED_PPR = Arm("ppr")
"""Probabilistic policy reuse with the best of four nu for each target, on the seeds that are shown."""

OTHERS = ("warm_start",)
"""Agents other than the paper's that every row has."""


def markdown(head: Iterable[object], rows: Iterable[Iterable[object]]) -> str:
    """Return a table as text."""
    return "\n".join(table(head, rows))


def interval(estimate: Estimate | None, digits: int | None = None) -> str:
    """Return '+5.1 [-2.0, +12.2]', by default with two decimals where it is narrow; '-' for none."""
    if estimate is None:
        return "-"
    if digits is None:
        spread = abs(estimate.value) if estimate.low is None or estimate.high is None else estimate.high - estimate.low
        digits = 2 if spread < 2 else 1
    ends = "" if estimate.low is None else f" [{estimate.low:+.{digits}f}, {estimate.high:+.{digits}f}]"
    return f"{estimate.value:+.{digits}f}{ends}"


def plain(estimate: Estimate) -> str:
    """Return '0.88 [0.83, 0.92]'."""
    ends = "" if estimate.low is None else f" [{estimate.low:.2f}, {estimate.high:.2f}]"
    return f"{estimate.value:.2f}{ends}"


def table_1(curves: Curves) -> str:
    """Return Table 1: AUC of each agent, its transfer ratio and its difference from dqn, next to the paper's."""
    rows = [row for target in ROWS for row in _rows(curves, target)]
    head = ("target", "agent", "seeds", "sources", "AUC (sd)", "transfer ratio [95 %]", "difference [95 %]", "paper")
    return markdown(head, rows)


def _rows(curves: Curves, target: str) -> Iterable[Sequence[object]]:
    """Yield a row per agent that was run; one that says so where none was."""
    if all(curves.best(target, Arm(agent)).empty for agent in (*AGENTS, *OTHERS)):
        paper = "; ".join(f"{agent} {row}" for agent, row in zip(AGENTS, TABLE_1.get(target, ()), strict=False))
        yield target, "all", 0, "-", "not run yet", "-", "-", paper or "-"
        return
    for agent in (*AGENTS, *OTHERS):
        arm = Arm(agent)
        cells = curves.best(target, arm)
        paper = TABLE_1[target][AGENTS.index(agent)] if target in TABLE_1 and agent in AGENTS else "-"
        if cells.empty:
            yield target, agent, 0, "-", "not run", "-", "-", paper
            continue
        said, sources = mean_sd(cells), cells["source_cell"].nunique() or "-"
        if agent == DQN.agent:
            yield target, agent, seeds(cells), sources, said, "-", "-", paper
            continue
        both = curves.paired(target, arm, DQN)
        yield target, agent, seeds(cells), sources, said, _ratio(both), interval(difference(both)), paper


def mean_sd(cells: pd.DataFrame) -> str:
    """Return mean AUC and standard deviation over cells, as text."""
    digits = 2 if statistics.sd(list(cells["auc"])) < 1 else 1
    return f"{cells['auc'].mean():.{digits}f} ({statistics.sd(list(cells['auc'])):.{digits}f})"


def _ratio(both: pd.DataFrame) -> str:
    found = transfer_ratio(both)
    if found is None:
        return "-"
    if found.value is None:
        return "undefined"
    percent = Estimate(*(None if end is None else 100 * end for end in (found.value, found.low, found.high)))  # type: ignore[arg-type]
    return interval(percent) + " %"


def early(curves: Curves) -> str:
    """Return the early AUC, and its difference from dqn; empty where nothing was run."""
    rows = []
    for target in ROWS:
        for agent in (*AGENTS[1:], *OTHERS):
            both = curves.paired(target, Arm(agent), DQN)
            if (gap := difference(both, "early")) is not None:
                means = (f"{both[column].mean():.1f}" for column in ("early_base", "early"))
                after = interval(difference(both, "after_start"))
                factor = curves.best(target, Arm(agent))["factor"].mean()
                said = "-" if math.isnan(factor) else f"{factor:.2f}"
                rows.append((target, agent, seeds(both), *means, interval(gap), said, after))
    head = (
        *("target", "agent", "seeds", "dqn", "agent's", "difference [95 %]", "factor of the advice"),
        "difference in the whole AUC without the first evaluation [95 %]",
    )
    return markdown(head, rows) if rows else ""


def tabular(curves: Curves) -> str:
    """Return AUC and difference from Q-learning of the tabular agents, with the paper's threshold and nu."""
    rows = []
    for target in (SMALL, REVERSED, *DEMANDS):
        gate = GATE if target in (SMALL, REVERSED) else SUPPLY_GATE
        for arm in (Q, REUSE, PPR, TUNED_PPR, gate, Arm("confidence_gate"), Arm("q_warm_start")):
            cells = curves.best(target, arm)
            if cells.empty:
                continue
            name = "ppr (best nu)" if arm == TUNED_PPR else arm
            gap = None if arm == Q else difference(curves.paired(target, arm, Q))
            rows.append((target, name, seeds(cells), mean_sd(cells), interval(gap)))
    return markdown(("target", "agent", "seeds", "AUC (sd)", "difference from q_learning [95 %]"), rows)


def verdicts(found: Sequence[tuple[Claim, list[Finding]]]) -> str:
    """Return a row per comparison that was run, claim by claim."""
    rows = []
    for claim, findings in found:
        for number, finding in enumerate(finding for finding in findings if finding.p is not None):
            part = finding.comparison
            sign = ">" if part.kind == "above" else "≥"
            what = STATISTICS[part.column]
            rows.append(
                (
                    f"*{claim.name}*" if number == 0 else "",
                    f"{part.better} {sign} {part.worse}{what}",
                    part.target,
                    finding.seeds,
                    interval(finding.difference),
                    p_text(finding.p),
                    p_text(finding.corrected),
                    finding.verdict,
                )
            )
    head = ("claim", "comparison", "target", "seeds", "difference [95 %]", "p", "p, Holm", "verdict")
    return markdown(head, rows)


def p_text(value: float | None) -> str:
    """Return a p-value as text; '-' for none."""
    return "-" if value is None else "< .001" if value < 0.001 else f"{value:.3f}"


def sentences(found: Sequence[tuple[Claim, list[Finding]]]) -> str:
    """Return each claim with a summary of its verdicts."""
    rows = [(f"*{claim.name}*", f"{claim.sentence} ({claim.where})", counted(findings)) for claim, findings in found]
    return markdown(
        ("claim", "the paper says", f"of its comparisons (margin {MARGIN:.0%} where it says no worse)"), rows
    )


def theorems(pairs: Sequence[tuple[str, str]]) -> str:
    """Return Theorem 1's quantities for each (source, target)."""
    rows = []
    for source, target in pairs:
        found = exact(source, target)
        numbers = (found.max_abs_delta, found.task_distance, found.theorem1_bound, found.v_source, found.v_target)
        holds = "yes" if found.theorem1_holds and found.theorem3_holds else "NO"
        rows.append((target, *(f"{number:.2f}" for number in numbers), holds))
    head = ("target", "max \\|delta\\|", "distance", "Theorem 1's bound", "V\\*_src(s0)", "V\\*_trg(s0)", "both hold")
    return markdown(head, rows)


def progress(curves: Curves) -> str:
    """Return which rows of Table 1 are finished, and the command that continues each task."""
    rows = []
    for task, planned in PLANNED.items():
        targets = [target for target in ROWS if target.startswith(f"{task}:")]
        arms = [(target, Arm(agent)) for target in targets for agent in (*AGENTS, *OTHERS)]
        done = sum(min(seeds(curves.best(target, arm)), planned) for target, arm in arms)
        name = f"table1-{task.replace('_', '-')}"
        command = f"`deltatune sweep reproduction --tasks {task} --seeds {planned} --name {name}`"
        rows.append((task, f"{done} of {len(arms) * planned}", command))
    return markdown(("task", "cells of Table 1", "the command that continues"), rows)
