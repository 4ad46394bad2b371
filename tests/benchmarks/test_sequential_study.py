"""The study of `seeds: auto`: what it reads, and that its columns say what they promise."""

from __future__ import annotations

import sys

import numpy as np
import pytest

from benchmarks.studies import sequential_seeds
from benchmarks.studies.sequential_seeds import DATASET, SCENARIOS, recorded, simulate
from orchestrator.analysis.inference.adastop import Design
from orchestrator.dataset.dataset import Dataset


@pytest.mark.parametrize("name", SCENARIOS)
def test_every_scenario_has_twenty_recorded_seeds_of_each_agent(name: str) -> None:
    aucs = recorded(name, Dataset(DATASET))
    assert {len(values) for values in aucs.values()} == {20}
    assert all(np.isfinite(values).all() for values in aucs.values())


def test_clear_differences_are_decided_early_and_equal_agents_take_the_budget() -> None:
    rng = np.random.default_rng(1)
    clear = {agent: rng.normal(place, 0.1, 20) for place, agent in enumerate(("dqn", "es", "delta_es"))}
    design = Design(5, 4, 0.05)
    told = simulate(clear, "as recorded", design, 10)
    assert (told.error, told.decided, told.fixed_decided) == (0, 1, 1)
    assert told.cells <= 0.5
    same = simulate(clear, "equal", design, 20)
    assert (same.decided, same.fixed_decided) == (0, 0)
    assert same.cells > 0.9
    assert same.error <= 0.2


def test_the_command_prints_a_line_for_each_scenario_truth_and_budget(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    words = ["--sweeps", "2", "--scenarios", "CartPole x5", "--max", "10"]
    monkeypatch.setattr(sys, "argv", ["sequential_seeds", *words])
    sequential_seeds.main()
    lines = capsys.readouterr().out.splitlines()
    assert [line.split("|")[2] for line in lines[2:]] == list(sequential_seeds.TRUTHS)
