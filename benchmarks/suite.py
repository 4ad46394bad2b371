"""The speed benchmarks as rows that are compared with peers and limits."""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Callable, Iterator
from typing import Any

from benchmarks.row import Row

PEERS = {"sb3": "stable-baselines3", "cleanrl": "plain torch, CleanRL-style"}

PLAIN = {"actors": "plain Ray actors", "tune": "plain Ray Tune, a trial each", "start": "plain Ray Tune, start and end"}

FIRST_CELL = 8.0
"""Seconds in which the first cell of the demo is to be there."""

DELTA = 1.25
"""Times the processor time of a whole cell of dqn that one of delta_es may take."""

PAGE = 3.0
"""Seconds in which a page of MLflow is to open."""

SYNC = 0.006
"""Seconds that the sync of a cell with MLflow is to take."""

WORKING = 1000
"""Cells of 50 ms whose wall time is compared with that of plain Ray."""

GOAL = 2.5
"""Times the reference that a command which trains nothing may take."""


def learner(quick: bool) -> Iterator[Row]:
    """Yield environment steps per CPU second of training."""
    for found in _json("learner_speed", "--seconds", "2" if quick else "20"):
        task, steps = found["task"], found["steps_per_cpu_s"]
        for peer, name in PEERS.items():
            yield Row(f"dqn, {task}", steps, "steps/CPU s", name, found[f"{peer}_steps_per_cpu_s"])
        yield Row(f"delta_es, {task}", found["delta_es_steps_per_cpu_s"], "steps/CPU s", "dqn", steps)
    for found in _json("whole_cell", *(("--seeds", "1", "--episodes", "60") if quick else ())):
        yield Row(f"a cell of delta_es, {found['target']}", found["ratio"], "x dqn's", "goal", DELTA, more=False)


def update(quick: bool) -> Iterator[Row]:
    """Yield the arithmetic rate of one update."""
    found = _json("update_speed", "--seconds", "0.05" if quick else "0.5")
    limits = {"fused multiply-add peak": found["fma_peak"]["gflops"], "sgemm of this BLAS": found["sgemm"]["gflops"]}
    for name, row in found.items():
        if isinstance(row, dict) and "gflops" in row and name not in ("fma_peak", "sgemm"):
            for limit, rate in limits.items():
                yield Row(f"update, {name}", row["gflops"], "GFLOP/s", limit, rate)


def simulators(quick: bool) -> Iterator[Row]:
    """Yield the time of a step of each deep task."""
    for found in _json("simulator_speed", "--steps", "200" if quick else "2000"):
        yield Row(f"step, {found['task']}", found["step_us"], "us", "Gymnasium", found["gymnasium_us"], more=False)


def answers(quick: bool) -> Iterator[Row]:
    """Yield the response times of commands that train nothing."""
    found = _json("answers", "--rounds", "2" if quick else "7")
    limit = f"{GOAL:g} x import numpy, yaml, typer"
    for row in found["commands"]:
        yard = GOAL * found["yardstick_seconds"]
        yield Row(f"deltatune {row['command']}", row["seconds"], "s", limit, yard, more=False)


def scaling(quick: bool) -> Iterator[Row]:
    """Yield the overhead of sweeps."""
    found = _json("scaling", "--cells", "1000", *([] if quick else ["10000"]))
    work, plain = found["overhead"], _json("plain_ray", "actors", "tune", "--cells", str(WORKING))
    name = "1,000 cells of 50 ms"
    yield Row(name, work["run"], "s", "ideal wall time", work["work"] / work["workers"], more=False)
    for peer in ("actors", "tune"):  # their cells last 50 ms to the digit, ours nearly: the shares are what is compared
        theirs = plain["ideal"] / plain[peer]
        yield Row(name, work["work"] / work["workers"] / work["run"], "of the ideal", PLAIN[peer], theirs)
    call = 1000 * (plain["actors"] - plain["ideal"]) / WORKING
    for row in found["no-op"]:
        cells, cost = int(row["cells"]), 1000 * row["run"] / row["cells"]
        yield Row(f"{cells:,} cells of nothing", cost, "ms a cell", "a call of plain Ray actors", call, more=False)
        whole = row["mlflow"]
        yield Row(f"leaderboard of {cells:,} cells", row["leaderboard"], "s", "the whole sync", whole, more=False)
        yield Row(f"sync of {cells:,} cells", whole, "s", "goal", SYNC * cells, more=False)


def demo(quick: bool) -> Iterator[Row]:
    """Yield the wall time of the demo."""
    found, plain = _json("demo"), _json("plain_ray", "start")
    yield Row("demo, until its first cell", found["until the first cell"], "s", "goal", FIRST_CELL, more=False)
    yield Row("demo", found["wall"], "s", "its training on all workers", found["ideal"], more=False)
    yield Row(
        "demo without its training", found["wall"] - found["ideal"], "s", PLAIN["start"], plain["start"], more=False
    )


def tracking(quick: bool) -> Iterator[Row]:
    """Yield the cost of MLflow."""
    found = _json("tracking.cell_cost", "--cells", "20" if quick else "100")
    yield Row("MLflow, a cell of 501 points", found["cell"], "ms of CPU", "an empty run", found["floor"], more=False)
    cells = 100 if quick else 10_000
    for name, seconds in _json("tracking.pages", "--cells", str(cells)).items():
        if name != "cells":
            yield Row(f"{name}, {cells:,} cells", seconds, "s", "goal", PAGE, more=False)
    if quick:
        return
    runs = _json("tracking.sweep_cost")
    without = sorted(row["run"] for name, row in runs if name == "none")
    for name, row in runs:
        if name != "none":
            middle = without[len(without) // 2]
            yield Row(f"sweep with MLflow, {name}", row["run"], "s", "without", middle, more=False)


PARTS: dict[str, Callable[[bool], Iterator[Row]]] = {
    "learner": learner,
    "update": update,
    "simulators": simulators,
    "answers": answers,
    "demo": demo,
    "scaling": scaling,
    "tracking": tracking,
}


def _json(module: str, *words: str) -> Any:
    """Run a benchmark in a new process, and return its JSON."""
    command = [sys.executable, "-m", f"benchmarks.{module}", *words, "--json"]
    done = subprocess.run(command, stdout=subprocess.PIPE, text=True, check=True)
    return json.loads(done.stdout)
