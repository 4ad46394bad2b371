"""The safe agent beside the baselines, over all tasks on which both are published."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from benchmarks.reproduction.claims import DQN, WARM_START, Arm
from benchmarks.reproduction.curves import Curves, difference, seeds
from benchmarks.reproduction.mean_gain import mean_gain, references
from benchmarks.reproduction.tables import ROWS, interval, markdown, p_text, plain
from dashboards.figure_model import Chart, Level, Panel, Series
from orchestrator.analysis.inference import across_tasks, crossed
from orchestrator.analysis.inference.across_tasks import Scores
from orchestrator.analysis.inference.multiplicity import holm

SAFE = Arm("safe_start")
RIVALS = (DQN, Arm("es"), Arm("delta_es"), WARM_START, Arm("jsrl"))


@dataclass(frozen=True)
class Standings:
    """The safe agent and its rivals by normalised AUC."""

    tasks: tuple[str, ...]
    """Those on which the safe agent and dqn are published."""
    scores: dict[str, Scores]
    """Agent to a table (sources, seeds) per task; those that are published on all of them."""
    left_out: tuple[str, ...]


def standings(curves: Curves) -> Standings | None:
    """Return the standings; None until the safe agent and dqn are published on a task."""
    tasks = tuple(target for target in ROWS if seeds(curves.paired(target, SAFE, DQN)) > 1)
    if not tasks:
        return None
    arms = [arm for arm in (SAFE, *RIVALS) if all(seeds(curves.best(task, arm)) > 1 for task in tasks)]
    return Standings(
        tasks,
        {arm.agent: [_scores(curves, task, arm) for task in tasks] for arm in arms},
        tuple(arm.agent for arm in RIVALS if arm not in arms),
    )


def _scores(curves: Curves, target: str, arm: Arm) -> crossed.Table:
    low, high = references(target)
    return (crossed.rectangle(curves.best(target, arm), "auc") - low) / (high - low)


def table(found: Standings, curves: Curves) -> str:
    """Return IQM, how the safe agent compares, and the worst task of each agent."""
    rows, arms = [], {arm.agent: arm for arm in (SAFE, *RIVALS)}
    for agent, scores in sorted(found.scores.items(), key=lambda pair: -across_tasks.iqm(pair[1]).value):
        runs, gap, chance = sum(each.size for each in scores), "-", "-"
        if agent != SAFE.agent:
            gap = interval(mean_gain(curves, found.tasks, SAFE, arms[agent]))
            chance = plain(across_tasks.improvement(found.scores[SAFE.agent], scores))
        rows.append((agent, runs, plain(across_tasks.iqm(scores)), gap, chance, _worst(found, curves, arms[agent])))
    head = (
        "agent",
        "runs",
        "IQM [95 %]",
        "safe_start less the agent [95 %]",
        "P(safe_start is better) [95 %]",
        "worst difference from dqn [95 %]",
    )
    return markdown(head, rows)


def _worst(found: Standings, curves: Curves, arm: Arm) -> str:
    """Return the least difference from dqn, by the normalised AUC, and its task."""
    if arm == DQN:
        return "-"
    gaps = {task: difference(curves.paired(task, arm, DQN)) for task in found.tasks}
    known = {task: gap for task, gap in gaps.items() if gap is not None}
    if not known:
        return "-"
    task = min(known, key=lambda name: known[name].value / float(np.ptp(references(name))))
    return f"{interval(known[task])} on {task}"


def differences(found: Standings, curves: Curves) -> str:
    """Return the safe agent against every rival on every task, corrected together."""
    rows, tested = [], []
    for task in found.tasks:
        for arm in RIVALS:
            both = curves.paired(task, SAFE, arm)
            gap = difference(both)
            if gap is not None and gap.p is not None:
                rows.append((task, arm.agent, seeds(both), interval(gap), p_text(gap.p)))
                tested.append(gap.p)
    head = ("target", "safe_start less", "seeds", "difference [95 %]", "p", "p, Holm")
    return markdown(head, [(*row, p_text(p)) for row, p in zip(rows, holm(tested), strict=True)])


def profiles(found: Standings | None) -> Chart:
    """Return performance profiles; without panels where there is nothing to show."""
    caption = "Share of runs with a normalised AUC above each value, with pointwise 95 % intervals."
    if found is None:
        return Chart("safe", "Performance profiles", caption, caption, ())
    runs = np.concatenate([each.ravel() for scores in found.scores.values() for each in scores])
    levels = [float(level) for level in np.linspace(min(float(runs.min()), 0.0), max(float(runs.max()), 1.0), 61)]
    series = []
    for agent, scores in found.scores.items():
        value, low, high = (tuple(map(float, line)) for line in across_tasks.profile(scores, levels))
        series.append(Series(agent, agent, tuple(levels), value, band=(low, high)))
    panel = Panel(
        "Performance profiles",
        "normalised AUC",
        "share of runs above",
        tuple(series),
        levels=(Level(1.0, upright=True),),
    )
    return Chart("safe", "Performance profiles", caption, caption, (panel,), columns=1)
