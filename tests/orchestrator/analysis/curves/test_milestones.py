"""The AUC until the advice ends, the episodes to a solution, and the sentence beside a best configuration."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from scipy import stats

from dashboards.report import sections
from orchestrator.analysis.curves import milestones
from orchestrator.analysis.findings import Findings, find
from orchestrator.analysis.groups import Group
from orchestrator.analysis.metrics import METRICS
from orchestrator.analysis.selection import optimism
from orchestrator.analysis.tables.summary_table import COLUMNS, numbers, table
from orchestrator.export.best_params import read_params, write_best
from orchestrator.export.latex import table_1
from orchestrator.planning.arms import Label
from orchestrator.results.sweep_folder import Results
from orchestrator.results.tables.cell_row import cell_row
from orchestrator.tracking.mlflow.description import markdown
from orchestrator.tracking.mlflow.fields import group_figures
from search_spaces.loading import parse
from trainables.cell import Cell, Source
from trainables.tasks.registry import parse_task

TARGET = parse_task("cartpole:gravity=5x").name
EPISODES = np.arange(0, 401, 20)
SPACE = {
    "schema": 1,
    "name": "early",
    "seeds": 4,
    "scenarios": [{"source": {"task": "cartpole", "agent": "dqn"}, "targets": [TARGET]}],
    "agents": {"dqn": {}, "es": {}, "delta_es": {}},
    "hyperparameters": {"episodes": [400]},
}


def curve(agent: str, seed: int) -> np.ndarray:
    """Returns that reach 195 with advice after 200 + 20 seed episodes; without, not before the end for seed 3."""
    last = {"dqn": 300 + 40 * seed, "es": 200 + 20 * seed, "delta_es": 180 + 20 * seed}[agent]
    return np.minimum(200.0, 20 + 180 * EPISODES / last) - 0.3 * (seed + 1)


def made(folder: Path, *configurations: tuple[str, dict[str, Any]]) -> Findings:
    """The findings of a sweep of these agents with these hyperparameters, four seeds each."""
    rows, points = [], []
    for agent, values in configurations or (("dqn", {}), ("es", {}), ("delta_es", {})):
        source = None if agent == "dqn" else Source(task="cartpole", kind="learned", cell_id="a" * 16)
        for seed in range(4):
            cell = Cell.create(agent, TARGET, seed, {"episodes": 400, **values}, source)
            returns = curve(agent, seed)
            auc = float(returns.mean()) + values.get("learning_rate", 0)
            figures = {"auc": auc, "training_auc": auc, "initial_return": returns[0], "asymptotic": returns[-1]}
            rows.append(cell_row("transfer", cell, None, Label()) | {"status": "done"} | figures)
            points.append(pd.DataFrame({"cell_id": cell.id, "episode": EPISODES, "greedy_return": returns}))
    results = Results.create(folder, "early", parse("early", SPACE))
    return find(results, (pd.DataFrame(rows), pd.concat(points, ignore_index=True)))


def group_of(findings: Findings, agent: str) -> Group:
    return next(group for group in findings.best if group.agent == agent)


def test_the_early_auc_is_the_mean_until_the_advice_ends_for_every_agent(tmp_path: Path) -> None:
    findings = made(tmp_path)
    for agent in ("dqn", "es", "delta_es"):
        by_hand = [curve(agent, seed)[EPISODES <= 100].mean() for seed in range(4)]
        estimate = group_of(findings, agent).estimate("early_auc")
        interval = stats.t.interval(0.95, 3, np.mean(by_hand), stats.sem(by_hand))
        assert estimate is not None
        assert [estimate.value, estimate.low, estimate.high] == pytest.approx([np.mean(by_hand), *interval], rel=1e-12)


def test_the_early_difference_is_paired_by_seed(tmp_path: Path) -> None:
    findings = made(tmp_path)
    early = {agent: [curve(agent, seed)[EPISODES <= 100].mean() for seed in range(4)] for agent in ("dqn", "es")}
    test = stats.ttest_rel(early["es"], early["dqn"])
    estimate = group_of(findings, "es").estimate("early_difference")
    assert estimate is not None
    assert [estimate.value, estimate.p] == pytest.approx(
        [np.subtract(early["es"], early["dqn"]).mean(), test.pvalue], rel=1e-12
    )
    contrast = next(each for each in findings.contrasts if each.name == "es - dqn")
    assert contrast.early == estimate
    (asked,) = findings.contrast("es", "dqn", measure="early_auc")
    assert asked.difference == estimate
    assert asked.corrected is not None
    assert asked.corrected.p == estimate.p


def test_two_windows_are_never_mixed(tmp_path: Path) -> None:
    findings = made(tmp_path, ("dqn", {}), ("es", {"advice_fraction": 0.5}), ("delta_es", {"advice_fraction": 0.2}))

    def early(agent: str, until: int) -> float:
        return float(np.mean([curve(agent, seed)[until >= EPISODES].mean() for seed in range(4)]))

    of = {agent: group_of(findings, agent) for agent in ("dqn", "es", "delta_es")}
    shown = {agent: group.estimates["early_auc"].value for agent, group in of.items()}
    assert shown == pytest.approx(
        {"dqn": early("dqn", 80), "es": early("es", 200), "delta_es": early("delta_es", 80)}, rel=1e-12
    )
    assert of["es"].estimates["early_difference"].value == pytest.approx(
        early("es", 200) - early("dqn", 200), rel=1e-12
    )
    first = findings.contrasts[0]
    assert first.name == "delta_es - es"
    assert first.early is not None
    assert first.early.value == pytest.approx(early("delta_es", 80) - early("es", 80), rel=1e-12)


def test_episodes_to_solve_are_a_bound_where_a_seed_never_did(tmp_path: Path) -> None:
    findings = made(tmp_path)
    with_advice, without = group_of(findings, "es"), group_of(findings, "dqn")
    solved = [next(e for e, r in zip(EPISODES, curve("es", s), strict=True) if r >= 195) for s in range(4)]
    estimate = with_advice.estimate("episodes_to_solve")
    assert estimate is not None
    assert (estimate.value, estimate.at_least) == (np.mean(solved), None)
    bound = without.estimate("episodes_to_solve")
    assert bound is not None
    assert bound.at_least
    assert numbers(without)["solved"] == 0.75
    metric = next(metric for metric in METRICS if metric.key == "episodes_to_solve")
    assert metric.text(bound) == f"≥ {bound.value:.0f}"
    assert r"$\ge$ " in table_1(findings)


def test_without_advice_on_the_task_nothing_is_early(tmp_path: Path) -> None:
    findings = made(tmp_path, ("dqn", {}))
    assert findings.best[0].estimate("early_auc") is None
    columns, rows = table(findings.best)
    assert "early AUC mean (sd)" in COLUMNS
    assert "early AUC mean (sd)" not in columns
    assert all(len(row) == len(columns) for row in rows)


def test_an_early_auc_needs_two_evaluations(tmp_path: Path) -> None:
    findings = made(tmp_path, ("dqn", {}), ("es", {"advice_fraction": 0.04}))
    assert group_of(findings, "es").estimate("early_auc") is None
    assert group_of(findings, "es").estimate("auc") is not None


def test_a_table_without_points_stays_as_it_is() -> None:
    cells = pd.DataFrame({"cell_id": ["a"]})
    assert milestones.add(cells, pd.DataFrame({"cell_id": []})) is cells


def test_gymnasiums_thresholds_are_the_tasks() -> None:
    levels = {name: parse_task(name).family.solved_at for name in ("cartpole", "acrobot", "lunar_lander", "reacher")}
    assert levels == {"cartpole": 195.0, "acrobot": -100.0, "lunar_lander": 200.0, "reacher": -3.75}
    assert parse_task("gym:MountainCar-v0").family.solved_at == -110.0
    assert parse_task("windy_gridworld").family.solved_at is None


CHOSEN = (("dqn", {}), ("es", {"learning_rate": 0.001}), ("es", {"learning_rate": 0.002}))


def test_a_best_of_several_says_so_wherever_it_is_shown(tmp_path: Path) -> None:
    findings = made(tmp_path, *CHOSEN)
    said = optimism(findings.best)
    assert said is not None
    assert "1 best configuration was chosen among 2 by the seeds that also judge it" in said
    write_best(findings, tmp_path / "best.yaml")
    assert (tmp_path / "best.yaml").read_text().startswith(f"# {said}")
    assert read_params(tmp_path / "best.yaml")
    assert said in markdown(findings.results, findings.groups, findings.best)
    shown, _ = sections.sections(findings, sections.figures(findings))
    assert said in next(section.lead for section in shown if section.id == "results")
    assert said in table_1(findings)
    assert (numbers(group_of(findings, "es"))["tried"], numbers(group_of(findings, "dqn"))["tried"]) == (2, 1)
    assert group_figures(group_of(findings, "es"))[1]["chosen"].startswith("best of 2")


def test_one_configuration_or_a_confirmed_one_needs_no_such_sentence(tmp_path: Path) -> None:
    from dataclasses import replace

    assert optimism(made(tmp_path).best) is None
    chosen = made(tmp_path / "chosen", *CHOSEN).best
    assert optimism([replace(group, confirmed=group) for group in chosen]) is None
