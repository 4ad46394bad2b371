"""The benchmark runs and reports what it promises."""

from __future__ import annotations

import json
import sys

import pytest

pytest.importorskip("stable_baselines3", reason="the public peer is not installed")


@pytest.mark.slow
def test_the_json_names_every_promised_figure(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    from benchmarks import learner_speed

    monkeypatch.setattr(sys, "argv", ["learner_speed", "--tasks", "cartpole", "--seconds", "0.5", "--json"])
    learner_speed.main()
    (row,) = json.loads(capsys.readouterr().out)
    assert row["task"] == "cartpole"
    figures = {"steps_per_cpu_s", "sb3_steps_per_cpu_s", "cleanrl_steps_per_cpu_s", "ratio_to_sb3", "delta_es_cost"}
    assert all(row[name] > 0 for name in figures | {"update_us", "share_of_sgemm"})
