"""What delta costs over a whole cell of Table 1: `python -m benchmarks.whole_cell [--seeds N] [--episodes N] [--json]`.

CartPole at the paper's scale, on both of its targets: dqn and delta_es of the same seed take turns in one process,
advised by one source network, which is trained first. delta is trained while the advice acts, a quarter of the run.
A cell's episodes are as long as its agent is good, so steps per second are printed too.
"""

from __future__ import annotations

import argparse
import json
import statistics
import time
from typing import Any

from trainables.cell import Cell, Source
from trainables.knowledge import Knowledge
from trainables.numerics.threads import one_thread
from trainables.training.train import train

SOURCE, TARGETS = "cartpole", ("cartpole:gravity=5x", "cartpole:gravity=7x")


def measure(seeds: int, episodes: int) -> list[dict[str, Any]]:
    """Return, for each target, the median CPU seconds of both agents, of their ratio, and of steps per CPU second."""
    scale = {"episodes": episodes, "learning_rate": 1e-4}
    teacher = Cell.create("dqn", SOURCE, 0, scale)
    _, steps, knowledge = _trained(teacher, None)
    source = Source(task=SOURCE, kind="learned", cell_id=teacher.id, checkpoint="best", steps=steps)
    _trained(Cell.create("delta_es", TARGETS[0], 0, scale | {"episodes": 50}, source), knowledge)  # compiles
    found = []
    for target in TARGETS:
        runs = []
        for seed in range(seeds):
            plain = _trained(Cell.create("dqn", target, seed, scale), None)
            advised = _trained(Cell.create("delta_es", target, seed, scale, source), knowledge)
            runs.append((plain[0], advised[0], advised[0] / plain[0], plain[1] / plain[0], advised[1] / advised[0]))
        names = ("dqn_cpu_s", "delta_es_cpu_s", "ratio", "dqn_steps_per_cpu_s", "delta_es_steps_per_cpu_s")
        medians = dict(zip(names, (round(statistics.median(each), 3) for each in zip(*runs, strict=True)), strict=True))
        found.append({"target": target, "seeds": seeds, "episodes": episodes, **medians})
    return found


def _trained(cell: Cell, knowledge: Knowledge | None) -> tuple[float, int, Knowledge]:
    """Train a cell to its end; return its CPU seconds, its steps, and what it has learned."""
    begun, steps = time.process_time(), 0
    training = train(cell, knowledge)
    for point in training:
        steps = point.step
    return time.process_time() - begun, steps, training.knowledge()


def main() -> None:
    """Measure, and print a line a target or JSON."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, default=5)
    parser.add_argument("--episodes", type=int, default=4000)
    parser.add_argument("--json", action="store_true")
    asked = parser.parse_args()
    one_thread()
    found = measure(asked.seeds, asked.episodes)
    if asked.json:
        print(json.dumps(found))
        return
    for row in found:
        print("  ".join(f"{name} {value}" for name, value in row.items()))


if __name__ == "__main__":
    main()
