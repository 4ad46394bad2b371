"""The figures of docs/reproduction.md."""

from __future__ import annotations

from pathlib import Path

import pandas as pd

from benchmarks.reproduction import safe
from benchmarks.reproduction.claims import DEMANDS, DQN, GATE, PPR, REVERSED, SHARES, SMALL, SUPPLY_GATE, X5, Arm, Q
from benchmarks.reproduction.curves import Curves, Published, seeds, transfer_ratio
from benchmarks.reproduction.tables import OTHERS, ROWS, exact
from dashboards import style
from dashboards.figure_model import Chart, Level, Panel, Series
from dashboards.renderers import matplotlib_renderer
from orchestrator.analysis import statistics
from orchestrator.analysis.tables.paper_table1 import AGENTS


def draw(found: Published, folder: Path) -> list[Path]:
    """Write every figure that the published cells are there for; the files."""
    style.assign([*AGENTS, *OTHERS, "jsrl", "safe_start", "q_learning", "policy_reuse", "ppr", "delta_gate"])
    folder.mkdir(parents=True, exist_ok=True)
    paper = found.paper
    every = ratios(paper), advice_fractions(found.fractions), similarity(paper), algorithm_1(paper)
    charts = [chart for chart in (*every, safe.profiles(safe.standings(found.safe))) if chart.panels]
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
            both = curves.paired(target, Arm(agent), DQN)
            ratio = transfer_ratio(both)
            if ratio is not None and ratio.value is not None:
                rows.append((agent, ratio, seeds(both)))
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
        names = tuple(f"{agent} ({number})" for agent, _, number in rows)
        panels.append(
            Panel(target, "transfer ratio (%)", "", series, levels=(Level(0.0, upright=True),), y_ticks=names)
        )
    caption = "Transfer ratio with its 95 % interval; in brackets the seeds."
    return Chart("table1", "Table 1", caption, caption, tuple(panels))


APART = 0.04
"""How far beside a tick an agent's points lie, so that intervals do not cover each other."""


def advice_fractions(curves: Curves) -> Chart:
    """Figure 4: the AUC against the share of training with advice, beside dqn's; empty until two shares are there."""
    series = []
    for agent, aside in zip(AGENTS[1:], (-APART, APART), strict=True):
        found = [curves.mean(X5, Arm(agent, (("advice_fraction", at),))) for at in SHARES]
        known = [(place + aside, mean) for place, mean in enumerate(found) if mean is not None]
        if len(known) > 1:
            x, means = zip(*known, strict=True)
            band = tuple(mean.low for mean in means), tuple(mean.high for mean in means)
            series.append(Series(agent, agent, x, tuple(mean.value for mean in means), band, form="linked"))
    base = curves.mean(X5, DQN)
    levels = (Level(base.value, "dqn", "dqn"),) if base else ()
    ticks = tuple(f"{at:.0%}" for at in SHARES)
    panel = Panel(X5, "share of the training with advice", "AUC", tuple(series), X5, levels, ticks)
    caption = "AUC against the share of training with advice, with 95 % intervals over source networks and seeds."
    return Chart("figure4", "Figure 4", caption, caption, (panel,) if series else (), columns=1)


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
        ratio = transfer_ratio(curves.paired(target, Arm("policy_reuse"), Q))
        if ratio is None:
            continue
        delta = exact("windy_gridworld", target).max_abs_delta
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
