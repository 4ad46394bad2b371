"""Environment steps per CPU second of the deep agents, compared with public peers with the same work in the same run.

    python -m benchmarks.learner_speed --tasks cartpole lunar_lander --seconds 20 --json

One thread, one update per step, batch and network of Table 6. The learners take turns; each figure is the median of
its turns, each ratio the median of the ratios within a turn.
"""

from __future__ import annotations

import argparse
import json
import statistics
import time
from collections.abc import Callable

import numpy as np
import torch

from benchmarks.contestants import Contestant, ours, plain_torch, stable_baselines
from trainables.networks.numba_qnetwork import QNetwork
from trainables.numerics.threads import one_thread
from trainables.tasks.make import make_env
from trainables.tasks.registry import families, parse_task

DEEP = [name for name, family in families().items() if "hidden_size" in family.defaults]
TURNS = 5


def compare(task: str, seconds: float) -> dict[str, float | str]:
    """Return the figures of one task, from `seconds` of CPU time for each learner."""
    contestants: dict[str, Contestant] = {
        "steps_per_cpu_s": ours(task),
        "delta_es_steps_per_cpu_s": ours(task, "delta_es"),
        "sb3_steps_per_cpu_s": stable_baselines(task),
        "cleanrl_steps_per_cpu_s": plain_torch(task),
    }
    for work in contestants.values():
        work(min(1.0, seconds / TURNS))
    rates: dict[str, list[float]] = {name: [] for name in contestants}
    for _ in range(TURNS):
        for name, work in contestants.items():
            steps, spent = work(seconds / TURNS)
            rates[name].append(steps / spent)

    def ratio(over: str, under: str) -> float:
        return round(statistics.median(a / b for a, b in zip(rates[over], rates[under], strict=True)), 2)

    row: dict[str, float | str] = {"task": task}
    row |= {name: round(statistics.median(values), 1) for name, values in rates.items()}
    row["ratio_to_sb3"] = ratio("steps_per_cpu_s", "sb3_steps_per_cpu_s")
    row["ratio_to_cleanrl"] = ratio("steps_per_cpu_s", "cleanrl_steps_per_cpu_s")
    row["delta_es_cost"] = ratio("steps_per_cpu_s", "delta_es_steps_per_cpu_s")
    return row | update_alone(task)


def update_alone(task: str) -> dict[str, float]:
    """Return an update's time and arithmetic rate, and the rate of the machine's BLAS for a large product."""
    defaults, env = families()[task].defaults, make_env(parse_task(task))
    size, batch = int(defaults["hidden_size"]), int(defaults["batch_size"])
    inputs, actions = int(np.prod(env.observation_space.shape or ())), int(env.action_space.n)  # type: ignore[attr-defined]
    network = QNetwork((inputs, size, size, actions), batch, 1e-4, generator=torch.Generator().manual_seed(0))
    rng = np.random.default_rng(0)
    x, chosen = rng.standard_normal(inputs * batch).astype(np.float32), rng.integers(0, actions, batch)
    targets = rng.standard_normal(batch).astype(np.float32)
    update = _seconds(lambda: network.update(x, chosen, targets))
    weights = inputs * size + size * size + size * actions
    work = 2 * batch * (3 * weights - inputs * size)
    a, out = rng.standard_normal((512, 512)).astype(np.float32), np.empty((512, 512), np.float32)
    sgemm = 2 * 512**3 / _seconds(lambda: np.matmul(a, a, out=out))
    return {
        "update_us": round(update * 1e6, 1),
        "update_gflops": round(work / update / 1e9, 1),
        "sgemm_gflops": round(sgemm / 1e9, 1),
        "share_of_sgemm": round(work / update / sgemm, 2),
    }


def _seconds(call: Callable[[], object], spend: float = 0.3) -> float:
    """Return the median CPU seconds of a call over five turns."""
    call()
    turns = []
    for _ in range(5):
        count, start = 0, time.process_time()
        while time.process_time() - start < spend / 5:
            for _ in range(5):
                call()
            count += 5
        turns.append((time.process_time() - start) / count)
    return statistics.median(turns)


def main() -> None:
    """Measure, and print a table or JSON."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--tasks", nargs="+", choices=DEEP, default=DEEP)
    parser.add_argument("--seconds", type=float, default=20.0, help="CPU seconds for each learner on each task")
    parser.add_argument("--json", action="store_true")
    arguments = parser.parse_args()
    one_thread()
    rows = [compare(task, arguments.seconds) for task in arguments.tasks]
    if arguments.json:
        print(json.dumps(rows, indent=2))
        return
    for row in rows:
        print("\n".join(f"{name:26} {value}" for name, value in row.items()), end="\n\n")


if __name__ == "__main__":
    main()
