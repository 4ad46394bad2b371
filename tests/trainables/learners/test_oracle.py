"""The compiled kernels give the same bits as the plain Python functions that one reads."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from tests.trainables import oracle_cells
from trainables.learners import q_learning
from trainables.tasks.registry import model_of

Outcomes = dict[str, list[Any]]


@pytest.fixture(scope="module")
def plain(tmp_path_factory: pytest.TempPathFactory) -> Outcomes:
    model = tmp_path_factory.mktemp("oracle") / "model.npz"
    oracle_cells.save_model(model)
    command = [sys.executable, str(Path(oracle_cells.__file__)), str(model)]
    environment = os.environ | {"NUMBA_DISABLE_JIT": "1", "PYTHONPATH": str(Path(__file__).parents[3])}
    done = subprocess.run(command, env=environment, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    result: Outcomes = json.loads(done.stdout)
    return result


@pytest.fixture(scope="module")
def compiled() -> Outcomes:
    assert hasattr(q_learning.run_episodes, "py_func"), "this process must run compiled kernels"
    return {name: list(outcome) for name, outcome in oracle_cells.outcomes(model_of(oracle_cells.CHAIN)).items()}


@pytest.mark.parametrize("task", list(oracle_cells.SETTINGS))
@pytest.mark.parametrize("agent", oracle_cells.AGENTS)
def test_compiled_and_plain_runs_agree_in_every_bit(agent, task, plain, compiled) -> None:
    assert compiled[f"{agent}/{task}"] == plain[f"{agent}/{task}"]


def test_the_comparison_sees_different_runs_and_moving_gates(compiled) -> None:
    curves = [curve for curve, _, _ in compiled.values()]
    assert len(set(curves)) == len(curves) == 12
    flips = {name: moved for name, (_, _, moved) in compiled.items() if "gate/" in name}
    assert len(flips) == 4
    assert all(moved > 0 for moved in flips.values())
