"""The figures of docs/reproduction.md."""

from __future__ import annotations

from pathlib import Path

import pandas as pd

from benchmarks.reproduction.claims import DEMANDS, DQN, GATE, PPR, REVERSED, SMALL, SUPPLY_GATE, Arm, Q
from benchmarks.reproduction.curves import Curves
from benchmarks.reproduction.tables import OTHERS, ROWS
from dashboards import style
from dashboards.figure_model import Chart, Level, Panel, Series
from dashboards.renderers import matplotlib_renderer
from orchestrator.analysis import statistics
from orchestrator.analysis.tables.paper_table1 import AGENTS
from trainables.delta.bounds import bounds


def draw(curves: Curves, folder: Path) -> list[Path]:
    """Write every figure that the published cells are there for; the files."""
    style.assign([*AGENTS, *OTHERS, "q_learning", "policy_reuse", "ppr", "delta_gate"])
    folder.mkdir(parents=True, exist_ok=True)
    charts = [chart for chart in (ratios(curves), similarity(curves), algorithm_1(curves)) if chart.panels]
    paths = [path for chart in charts for path in matplotlib_renderer.draw(chart, "reproduction", folder)]
    for path in paths:
        if path.suffix == ".svg":
            path.unlink()
    return paths


def ratios(curves: Curves) -> Chart:
    """Transfer ratios of Table 1 with their intervals, a row per agent, a panel per target."""
    panels = []
    for target in ROWS:
        rows = []
        for agent in (*AGENTS[1:], *OTHERS):
            first, base = curves.paired(target, Arm(agent), DQN)
            if len(first) > 1 and (ratio := statistics.transfer_ratio(first, base)).value is not None:
                rows.append((agent, ratio, len(first)))
        if not rows:
            continue
        series = tuple(
            Series(
                agent,
                agent,
                (100 * (ratio.value or 0.0),),
                (float(place),),
                x_band=((100 * (ratio.low or 0.0),), (100 * (ratio.high or 0.0),)),
                form="points",
            )
            for place, (agent, ratio, _) in enumerate(rows)
        )
        names = tuple(f"{agent} ({seeds})" for agent, _, seeds in rows)
        panels.append(
            Panel(target, "transfer ratio (%)", "", series, levels=(Level(0.0, upright=True),), y_ticks=names)
        )
    caption = "Transfer ratio with its 95 % interval; in brackets the seeds."
    return Chart("table1", "Table 1", caption, caption, tuple(panels))


def similarity(curves: Curves) -> Chart:
    """Figure 1: the transfer ratio of direct reuse against the exact max |delta|."""
    found = similarities(curves)
    series = Series(
        "policy_reuse",
        "policy_reuse",
        tuple(found["delta"]),
        tuple(found["ratio"]),
        (tuple(found["low"]), tuple(found["high"])),
        form="points",
        names=tuple("" if name == "small" else name for name in found["name"]),
    )
    panel = Panel("windy gridworld", "max |delta|, exact", "transfer ratio (%)", (series,), levels=(Level(0.0),))
    caption = "Transfer ratio of reusing the learned source policy against the exact max |delta|."
    return Chart("figure1", "Figure 1", caption, caption, (panel,))


def similarities(curves: Curves) -> pd.DataFrame:
    """Return, per target of Figure 1, the exact max |delta| and the transfer ratio of reuse in percent."""
    rows = []
    for wind in ("", "small", "additional_1", "additional_2", "reversed"):
        target = f"windy_gridworld:wind={wind}" if wind else "windy_gridworld"
        first, base = curves.paired(target, Arm("policy_reuse"), Q)
        if len(first) < 2:
            continue
        ratio = statistics.transfer_ratio(first, base)
        delta = bounds("windy_gridworld", target).max_abs_delta
        ends = (100 * (end or 0.0) for end in (ratio.value, ratio.low, ratio.high))
        rows.append((wind or "the source's own task", delta, *ends))
    return pd.DataFrame(rows, columns=["name", "delta", "ratio", "low", "high"])


def algorithm_1(curves: Curves) -> Chart:
    """Figure 2: mean evaluation curves with Student's intervals over seeds."""
    panels = []
    for target in (SMALL, REVERSED, *DEMANDS):
        gate = GATE if target.startswith("windy") else SUPPLY_GATE
        series = tuple(s for arm in (Q, PPR, gate) if (s := _curve(curves, target, arm)) is not None)
        if series:
            panels.append(Panel(target, "episode", "greedy return", series, target))
    caption = "Mean greedy return with 95 % intervals over seeds."
    return Chart("figure2", "Figure 2", caption, caption, tuple(panels))


def _curve(curves: Curves, target: str, arm: Arm) -> Series | None:
    points = curves.points(target, arm)
    if points.empty:
        return None
    by_episode = [(episode, list(rows["greedy_return"])) for episode, rows in points.groupby("episode")]
    step = max(1, len(by_episode) // 100)
    kept = [(float(episode), statistics.mean(values)) for episode, values in by_episode[::step]]
    x, means = zip(*kept, strict=True)
    band = (tuple(mean.low for mean in means), tuple(mean.high for mean in means))
    return Series(arm.agent, arm.agent, x, tuple(mean.value for mean in means), band)
