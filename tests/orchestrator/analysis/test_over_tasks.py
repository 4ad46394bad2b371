"""Aggregates over tasks: rliable's numbers, scores by their references, and no certainty from five seeds.

The numbers called rliable's were computed by rliable 1.2.0 (its `metrics`, and `library` with 50,000 resamples, 20,000
for the profile) on X and Y below, as (runs, tasks).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

from dashboards.figure_model import Absent, Chart
from dashboards.figures import over_tasks as figure
from dashboards.renderers import matplotlib_renderer, plotly_renderer
from orchestrator.analysis.findings import Findings, find
from orchestrator.analysis.inference import across_tasks
from orchestrator.analysis.over_tasks import Entrant, number_table, over_tasks, reference
from orchestrator.export.formats import write
from orchestrator.planning.arms import Label
from orchestrator.results.sweep_folder import Results
from orchestrator.results.tables.cell_row import cell_row
from search_spaces.loading import built_in, load, parse
from search_spaces.narrow import narrow
from trainables.cell import Cell, Source
from trainables.errors import InputError
from trainables.tasks.registry import parse_task

X = np.array(
    [
        [0.31, 1.02, 0.55, -0.04],
        [0.47, 0.88, 0.71, 0.12],
        [0.22, 1.31, 0.64, 0.05],
        [0.58, 0.97, 0.49, 0.33],
        [0.40, 1.10, 0.80, 0.20],
    ]
)
Y = np.array(
    [
        [0.25, 0.70, 0.55, 0.01],
        [0.33, 0.91, 0.50, -0.10],
        [0.41, 0.86, 0.52, 0.15],
        [0.19, 0.79, 0.61, 0.02],
        [0.36, 0.95, 0.45, 0.09],
    ]
)


def tables(runs: np.ndarray) -> list[np.ndarray]:
    """(runs, tasks) as one table per task."""
    return [runs[:, task][None] for task in range(runs.shape[1])]


RLIABLE = {
    "iqm": (0.528, 0.417, (0.452975, 0.593)),
    "mean": (0.5555, 0.4275, (0.501, 0.612)),
    "median": (0.517, 0.417, (0.444, 0.591)),
    "optimality_gap": (0.466, 0.5725, (0.4185, 0.513)),
}


@pytest.mark.parametrize("name", RLIABLE)
def test_an_aggregate_and_its_interval_are_rliables(name: str) -> None:
    aggregate = getattr(across_tasks, name)
    x, y, ends = RLIABLE[name]
    estimate = aggregate(tables(X))
    assert [estimate.value, aggregate(tables(Y)).value] == pytest.approx([x, y], rel=1e-12)
    assert [estimate.low, estimate.high] == pytest.approx(ends, abs=0.01)  # two thousand resamples


def test_a_performance_profile_is_rliables() -> None:
    value, low, high = across_tasks.profile(tables(X), [0.0, 0.25, 0.5, 0.75, 1.0])
    assert list(value) == pytest.approx([0.95, 0.75, 0.5, 0.3, 0.15], rel=1e-12)
    assert list(low) == pytest.approx([0.85, 0.65, 0.4, 0.25, 0.05], abs=0.051)
    assert list(high) == pytest.approx([1.0, 0.85, 0.6, 0.4, 0.25], abs=0.051)


def test_the_middle_half_is_scipys_trimmed_mean() -> None:
    from scipy import stats

    rng = np.random.default_rng(3)
    for runs in range(1, 14):
        x = rng.normal(size=(runs, 3))
        assert across_tasks.iqm(tables(x)).value == pytest.approx(float(stats.trim_mean(x.ravel(), 0.25)), rel=1e-12)


@pytest.mark.parametrize("name", RLIABLE)
def test_a_task_with_more_runs_weighs_no_more_than_another(name: str) -> None:
    aggregate = getattr(across_tasks, name)
    few = tables(np.tile(X, (4, 1)))  # each run four times: nothing changes, whatever is left of a quarter
    more = [np.tile(table, (1, 3)) if task == 1 else table for task, table in enumerate(few)]
    assert aggregate(more).value == pytest.approx(aggregate(few).value, rel=1e-12)


def test_a_profile_weighs_every_task_the_same() -> None:
    levels = [0.0, 0.25, 0.5, 0.75, 1.0]
    more = [np.tile(table, (1, 3)) if task == 1 else table for task, table in enumerate(tables(X))]
    assert list(across_tasks.profile(more, levels)[0]) == pytest.approx(
        list(across_tasks.profile(tables(X), levels)[0]), rel=1e-12
    )


def test_the_probability_of_improvement_is_rliables_and_never_sure() -> None:
    assert across_tasks.improvement(tables(X), tables(Y)).value == pytest.approx(0.775, rel=1e-12)
    sure = across_tasks.improvement(tables(X + 10), tables(Y))
    assert (sure.value, sure.high) == (1.0, 1.0)
    assert sure.low is not None
    assert 0.6 < sure.low < 0.95
    alike = across_tasks.improvement(tables(X), tables(X))
    assert alike.value == 0.5


@pytest.mark.parametrize("shift", [0.0, 1.0])
def test_its_interval_covers_as_often_as_it_says(shift: float) -> None:
    from scipy import stats

    rng, hits, truth = np.random.default_rng(1), 0, float(stats.norm.cdf(shift / np.sqrt(2)))
    for _ in range(300):
        x, y = rng.normal(shift, 1, (5, 4)), rng.normal(0, 1, (5, 4))
        chance = across_tasks.improvement(tables(x), tables(y))
        assert chance.low is not None
        assert chance.high is not None
        hits += chance.low <= truth <= chance.high
    assert hits / 300 > 0.92


def test_crossed_sources_make_an_interval_wider() -> None:
    rng = np.random.default_rng(0)
    source, seed = rng.normal(size=(4, 1)), rng.normal(size=(1, 6)) * 0.1
    crossed = across_tasks.mean([source + seed])
    flat = across_tasks.mean([(source + seed).reshape(1, -1)])
    assert None not in (crossed.low, crossed.high, flat.low, flat.high)
    assert crossed.high - crossed.low > 1.5 * (flat.high - flat.low)  # type: ignore[operator]


def test_one_run_of_each_task_has_no_interval() -> None:
    assert across_tasks.iqm([np.array([[0.5]]), np.array([[0.7]])]).low is None


TARGETS = ("cartpole:gravity=5x", "acrobot:link_mass=2")
SPACE: dict[str, Any] = {
    "schema": 1,
    "name": "over",
    "seeds": 3,
    "scenarios": [
        {"source": {"task": target.partition(":")[0], "agent": "dqn"}, "targets": [target]} for target in TARGETS
    ],
    "agents": {"dqn": {}, "es": {}, "delta_es": {}},
    "normalise": {"cartpole": [20, 195], "acrobot:link_mass=2": [-500, -100]},
}
AUCS: Mapping[str, Sequence[Sequence[float]]] = {
    "dqn": ([100.0, 110.0, 120.0], [-300.0, -310.0, -260.0]),
    "es": ([130.0, 120.0, 150.0], [-280.0, -330.0, -280.0]),
    "delta_es": ([150.0, 130.0, 160.0], [-200.0, -290.0, -210.0]),
}


def made(folder: Path, aucs: Mapping[str, Sequence[Sequence[float]]] = AUCS, **changes: Any) -> Findings:
    rows, points = [], []
    for agent, by_target in aucs.items():
        for target, values in zip(TARGETS, by_target, strict=False):
            source = Source(task=target.partition(":")[0], kind="learned", cell_id="a" * 16)
            for seed, auc in enumerate(values):
                cell = Cell.create(agent, target, seed, {}, None if agent == "dqn" else source)
                figures = dict.fromkeys(("auc", "training_auc", "initial_return", "asymptotic"), auc)
                rows.append(cell_row("transfer", cell, None, Label()) | {"status": "done"} | figures)
                curve = {"cell_id": cell.id, "episode": [0, 500, 4000], "greedy_return": [auc - 10, auc, auc + 10]}
                points.append(pd.DataFrame(curve))
    results = Results.create(folder, "over", parse("over", SPACE | changes))
    return find(results, (pd.DataFrame(rows), pd.concat(points, ignore_index=True)))


def test_scores_are_normalised_by_the_task_or_its_family(tmp_path: Path) -> None:
    found = made(tmp_path).over_tasks
    assert found.tasks == tuple(parse_task(target).name for target in TARGETS)
    scores = {standing.entrant.agent: standing.scores for standing in found.standings}
    for agent, (cart, acrobot) in AUCS.items():
        assert list(scores[agent][0][0]) == pytest.approx([(auc - 20) / 175 for auc in cart], rel=1e-12)
        assert list(scores[agent][1][0]) == pytest.approx([(auc + 500) / 400 for auc in acrobot], rel=1e-12)
    early = next(standing.early for standing in found.standings if standing.entrant.agent == "es")
    assert early is not None
    assert list(early[0][0]) == pytest.approx([(auc - 5 - 20) / 175 for auc in AUCS["es"][0]], rel=1e-12)


def test_the_worst_task_is_told_by_the_normalised_difference(tmp_path: Path) -> None:
    worst = {standing.entrant.agent: standing.worst for standing in made(tmp_path).over_tasks.standings}
    assert worst["dqn"] is None
    assert worst["es"] is not None
    assert worst["es"][0] == parse_task(TARGETS[1]).name
    assert worst["es"][1].value == pytest.approx(np.subtract(AUCS["es"][1], AUCS["dqn"][1]).mean() / 400, rel=1e-12)


def test_delta_es_against_es_comes_first(tmp_path: Path) -> None:
    pairs = [(each.first.agent, each.second.agent) for each in made(tmp_path).over_tasks.improvements]
    assert pairs == [("delta_es", "es"), ("es", "dqn"), ("delta_es", "dqn")]


def test_an_agent_that_lacks_a_task_is_left_out_and_named(tmp_path: Path) -> None:
    findings = made(tmp_path, {**AUCS, "es": AUCS["es"][:1]})
    assert findings.over_tasks.left_out == (Entrant("es", "learned"),)
    chart = figure.chart(findings)
    assert isinstance(chart, Chart)
    assert "Left out, for want of a task: es." in chart.caption


def test_both_renderers_draw_the_figures(tmp_path: Path) -> None:
    findings = made(tmp_path)
    for draw in (figure.chart, figure.performance_profile):
        chart = draw(findings)
        assert isinstance(chart, Chart)
        assert plotly_renderer.specs(chart)
        assert all(path.stat().st_size > 1000 for path in matplotlib_renderer.draw(chart, "over", tmp_path))
    profile = figure.performance_profile(findings)
    assert isinstance(profile, Chart)
    line = profile.panels[0].series[0]
    assert line.y[0] == 1.0
    assert line.y[-1] == 0.0


def test_without_references_there_is_a_sentence_that_says_what_to_add(tmp_path: Path) -> None:
    findings = made(tmp_path, normalise={})
    for draw in (figure.chart, figure.performance_profile):
        absent = draw(findings)
        assert isinstance(absent, Absent)
        assert "add normalise:" in absent.reason
    assert over_tasks([], pd.DataFrame(), {}).standings == ()


@pytest.mark.parametrize("form", ["csv", "parquet"])
def test_the_aggregates_are_exported(tmp_path: Path, form: str) -> None:
    findings = made(tmp_path)
    write(findings, form, tmp_path / "out")
    path = tmp_path / "out" / f"over_tasks.{form}"
    table = pd.read_csv(path) if form == "csv" else pd.read_parquet(path)
    assert list(table["agent"]) == ["dqn", "es", "delta_es"]
    assert list(table["iqm"]) == list(number_table(findings.over_tasks)["iqm"])
    assert (table["iqm_low"] < table["iqm"]).all()


@pytest.mark.parametrize(
    ("normalise", "says"),
    [
        ({"cartpole": [195, 20]}, "the lower one first"),
        ({"cartpole": [1]}, "two returns"),
        ({"cartpole": [0, float("nan")]}, "two returns"),
        ({"cartpool": [0, 1]}, "cartpool"),
        ({"cartpole:gravity=5x": [0, 1], "cartpole:gravity=49": [0, 2]}, "given twice"),
    ],
)
def test_wrong_references_are_one_sentence(normalise: dict[str, Any], says: str) -> None:
    with pytest.raises(InputError, match=says):
        parse("over", SPACE | {"normalise": normalise})


def test_references_are_kept_when_a_space_is_narrowed() -> None:
    space = parse("over", SPACE)
    assert narrow(space, tasks=["cartpole"]).normalise == space.normalise
    assert parse("over", space.to_json()) == space


@pytest.mark.parametrize("name", built_in())
def test_every_target_of_a_built_in_space_has_references(name: str) -> None:
    space = load(name)
    for scenario in space.scenarios:
        for target in scenario.targets:
            assert reference(parse_task(target).name, space.normalise), target
