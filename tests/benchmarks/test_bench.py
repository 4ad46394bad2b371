"""`make bench`: one table of all figures beside peers and limits, and two of them compared."""

from __future__ import annotations

import json
import subprocess
import sys
from collections import Counter
from collections.abc import Iterator
from dataclasses import asdict
from pathlib import Path
from typing import Any

import pytest

from benchmarks import __main__ as bench
from benchmarks import suite
from benchmarks.compare import compared, read
from benchmarks.row import Row, table

FAST, SLOW = Row("dqn, cartpole", 300.0, "steps/CPU s", "peer", 100.0), Row("step", 4.0, "us", "peer", 2.0, more=False)

SAID: dict[str, Any] = {
    "learner_speed": [
        {
            "task": "cartpole",
            "steps_per_cpu_s": 30.0,
            "delta_es_steps_per_cpu_s": 20.0,
            "sb3_steps_per_cpu_s": 1.0,
            "cleanrl_steps_per_cpu_s": 2.0,
        }
    ],
    "update_speed": {
        "lanes": 16,
        "fma_peak": {"gflops": 100.0},
        "sgemm": {"gflops": 80.0},
        "cartpole, dead 0": {"gflops": 40.0},
        "cartpole, adam alone": {"us": 1.0},
    },
    "simulator_speed": [{"task": "cartpole", "step_us": 1.0, "gymnasium_us": 10.0}],
    "answers": {"yardstick_seconds": 0.2, "commands": [{"command": "status", "seconds": 0.4}]},
    "demo": {"until the first cell": 10.0, "wall": 30.0, "ideal": 15.0},
    "scaling": {
        "overhead": {"run": 30.0, "work": 50.0, "workers": 2.0},
        "no-op": [{"cells": 1000.0, "run": 4.0, "leaderboard": 3.0, "mlflow": 12.0}],
    },
    "plain_ray": {"start": 6.0, "actors": 28.0, "tune": 50.0, "ideal": 25.0},
    "whole_cell": [{"target": "cartpole:gravity=5x", "ratio": 1.2}],
    "tracking.pages": {"cells": 10000, "Leaderboard, first visit": 4.0},
    "tracking.cell_cost": {"cell": 30.0, "floor": 15.0},
    "tracking.sweep_cost": [["none", {"run": 50.0}], ["sqlite", {"run": 51.0}]],
}


def test_every_part_is_compared_with_a_peer_or_a_limit(monkeypatch: pytest.MonkeyPatch) -> None:
    ran = Counter[str]()

    def said(module: str, *words: str) -> Any:
        ran.update(set(words) & {"start", "actors", "tune"})
        return SAID[module]

    monkeypatch.setattr(suite, "_json", said)
    rows = {(row.name, row.beside): row for part in suite.PARTS.values() for row in part(False)}
    found = {key: round(row.ratio, 3) for key, row in rows.items()}
    assert found["dqn, cartpole", "stable-baselines3"] == 30.0
    assert found["dqn, cartpole", "plain torch, CleanRL-style"] == 15.0
    assert found["delta_es, cartpole", "dqn"] == 0.667
    assert found["update, cartpole, dead 0", "fused multiply-add peak"] == 0.4
    assert found["update, cartpole, dead 0", "sgemm of this BLAS"] == 0.5
    assert found["step, cartpole", "Gymnasium"] == 10.0
    assert found["deltatune status", "2.5 x import numpy, yaml, typer"] == 1.25
    assert found["demo, until its first cell", "goal"] == 0.8
    assert found["a cell of delta_es, cartpole:gravity=5x", "goal"] == 1.042
    assert found["Leaderboard, first visit, 10,000 cells", "goal"] == 0.75
    assert found["demo", "its training on all workers"] == 0.5
    assert found["demo without its training", "plain Ray Tune, start and end"] == 0.4
    assert found["1,000 cells of 50 ms", "ideal wall time"] == 0.833
    assert found["1,000 cells of 50 ms", "plain Ray actors"] == 0.933
    assert found["1,000 cells of 50 ms", "plain Ray Tune, a trial each"] == 1.667
    assert found["1,000 cells of nothing", "a call of plain Ray actors"] == 0.75
    assert found["sync of 1,000 cells", "goal"] == 0.5
    assert ran == {"start": 1, "actors": 1, "tune": 1}, "nothing is measured twice"
    assert found["MLflow, a cell of 501 points", "an empty run"] == 0.5
    assert found["sweep with MLflow, sqlite", "without"] == 0.98
    assert len(table(list(rows.values())).splitlines()) == len(rows) + 1


def test_two_runs_are_compared_by_figure_and_by_ratio(tmp_path: Path) -> None:
    def written(name: str, *rows: Row) -> Path:
        told = {"commit": name, "machine": {"processor": "x", "cores": 2}, "rows": [asdict(row) for row in rows]}
        (tmp_path / name).write_text(json.dumps(told))
        return tmp_path / name

    a = written("a", FAST, SLOW)
    b = written("b", Row(FAST.name, 150.0, FAST.unit, "peer", 50.0), Row("new", 1.0, "s", "peer", 1.0))
    lines = compared(read(a)[1], read(b)[1])
    assert lines[1].split()[-2:] == ["0.50", "1.00"], "half as fast, on a machine that is half as fast"
    assert lines[2:] == ["step compared with peer: only in A", "new compared with peer: only in B"]
    command = [sys.executable, "-m", "benchmarks.compare", str(a), str(tmp_path / "missing")]
    refused = subprocess.run(command, capture_output=True, text=True)
    assert (refused.returncode, "missing' is not a file written by" in refused.stderr) == (2, True)


def test_a_part_that_fails_costs_no_other(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def broken(quick: bool) -> Iterator[Row]:
        raise subprocess.CalledProcessError(3, ["python", "-m", "benchmarks.demo"])

    monkeypatch.setattr(bench, "PARTS", {"demo": broken, "steps": lambda quick: iter([SLOW])})
    monkeypatch.setattr(sys, "argv", ["bench", "--json", str(tmp_path / "bench.json")])
    with pytest.raises(SystemExit, match=r"demo: python -m benchmarks\.demo has ended with exit code 3"):
        bench.main()
    assert list(read(tmp_path / "bench.json")[1].values()) == [SLOW]
    assert "step" in capsys.readouterr().out


def test_a_part_is_measured_and_written_as_json(tmp_path: Path) -> None:
    command = [sys.executable, "-m", "benchmarks", "simulators", "--quick", "--json", str(tmp_path / "bench.json")]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    machine, rows = read(tmp_path / "bench.json")
    assert machine["cores"] >= 1
    assert {name for name, _ in rows} >= {"step, cartpole", "step, reacher"}
    assert "Gymnasium" in done.stdout
    unknown = subprocess.run([*command[:3], "sims"], capture_output=True, text=True)
    assert (unknown.returncode, "no part 'sims'" in unknown.stderr) == (2, True)
