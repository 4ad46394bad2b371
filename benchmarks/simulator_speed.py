"""Microseconds of CPU time for a step of each deep task's environment, compared with Gymnasium's in the same run.

    python -m benchmarks.simulator_speed --json

The two take turns under the same random actions; each figure is the median of the turns, the ratio that of theirs.
"""

from __future__ import annotations

import argparse
import json
import statistics
import time

import numpy as np

from trainables.numerics.threads import one_thread
from trainables.tasks.make import make_env
from trainables.tasks.registry import parse_task
from trainables.tasks.step_env import Environment

TASKS = ("cartpole", "acrobot", "gym:MountainCar-v0", "gym:Pendulum-v1", "lunar_lander", "reacher")
TURNS = 7


def compare(task: str, steps: int) -> dict[str, float | str]:
    """Return the figures of one task, from turns of so many steps each."""
    plain = parse_task(task).family.plain
    assert plain is not None
    ours, theirs = Environment(make_env(parse_task(task))), Environment(plain(), simulated=False)
    turns = [(_microseconds(ours, steps), _microseconds(theirs, steps)) for _ in range(TURNS + 1)][1:]
    mine, other = (round(statistics.median(column), 2) for column in zip(*turns, strict=True))
    ratio = round(statistics.median(b / a for a, b in turns), 2)
    return {"task": task, "step_us": mine, "gymnasium_us": other, "ratio": ratio, "compiled": str(bool(ours.simulator))}


def _microseconds(env: Environment, steps: int) -> float:
    """Return the CPU time of a step, without the resets between episodes."""
    actions = np.random.default_rng(0).integers(env.actions, size=steps).tolist()
    env.reset(0)
    spent, start = 0.0, time.process_time()
    for number, action in enumerate(actions):
        _, _, terminated, truncated = env.step(action)
        if terminated or truncated:
            spent += time.process_time() - start
            env.reset(number)
            start = time.process_time()
    return (spent + time.process_time() - start) / steps * 1e6


def main() -> None:
    """Measure, and print a table or JSON."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--tasks", nargs="+", default=list(TASKS))
    parser.add_argument("--steps", type=int, default=2000, help="steps of one turn")
    parser.add_argument("--json", action="store_true")
    arguments = parser.parse_args()
    one_thread()
    rows = [compare(task, arguments.steps) for task in arguments.tasks]
    if arguments.json:
        print(json.dumps(rows, indent=2))
        return
    for row in rows:
        print("  ".join(f"{name} {value}" for name, value in row.items()))


if __name__ == "__main__":
    main()
