"""Measures of similarity against transfer ratios."""

from __future__ import annotations

import pytest

from dashboards.figures import metric_validity
from dashboards.renderers import matplotlib_renderer
from orchestrator.analysis.metric_validity import NAMES, correlations, measures, table
from trainables.delta.bounds import bounds


def test_the_measures_of_a_task_with_itself_are_0() -> None:
    found = measures("windy_gridworld", "windy_gridworld", 0.99)
    assert list(found.values()) == pytest.approx([0.0] * 5, abs=1e-9)


def test_the_measures_are_those_of_the_bounds_and_of_following(monkeypatch) -> None:
    monkeypatch.setattr("orchestrator.analysis.metric_validity.bisimulation.start_distance", lambda *_: 1.0)
    target = "windy_gridworld:wind=reversed"
    found, both = measures("windy_gridworld", target, 0.99), bounds("windy_gridworld", target)
    assert (found["max_delta"], found["task_distance"]) == (both.max_abs_delta, both.task_distance)
    assert found["path_delta"] == pytest.approx(-100 - both.v_source, abs=1.0)  # it never arrives
    assert 0 < found["path_rms_delta"] < both.max_abs_delta  # type: ignore[operator]


def test_a_sweep_gives_a_row_per_target_and_agent_and_a_figure(finished, tmp_path, monkeypatch) -> None:
    import pandas as pd

    monkeypatch.setattr("orchestrator.analysis.metric_validity.bisimulation.start_distance", lambda *_: 1.0)
    pairs = table(pd.read_parquet(finished / "small" / "cells.parquet"))
    assert len(pairs) == 2 * 2 * 3  # targets, kinds of source, policy_reuse and the gate at two thresholds
    assert set(NAMES) <= set(pairs.columns)
    drawn = matplotlib_renderer.draw(metric_validity.chart(correlations(pairs)), "small", tmp_path)
    assert [path.suffix for path in drawn] == [".png", ".svg"]
    assert all(path.stat().st_size > 1000 for path in drawn)
