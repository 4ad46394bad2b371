"""What Ray costs without deltatune: `python -m benchmarks.plain_ray [PART ...] [--cells N] [--seconds S] [--json]`.

Seconds of wall time, on one worker per CPU, of each PART (default: all):
  start   import Ray Tune, start Ray, run one trial on each CPU that does nothing, and end Ray
  actors  N calls that work S seconds each, by one actor per CPU, the actors' start included
  tune    the same work as N trials of one `tune.Tuner` that keeps its actors
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from typing import Any

from orchestrator.cluster.resources import local_cpus
from orchestrator.process_env import prepare


def start() -> float:
    """Return the seconds from the first import of Ray to its end, with a trial on each CPU in between."""
    started = time.perf_counter()
    tune(local_cpus(), 0.0)
    _ray().shutdown()
    return time.perf_counter() - started


def actors(cells: int, seconds: float) -> float:
    """Return the seconds that actors take for `cells` calls of `seconds` each, their own start included."""
    _ray()
    started = time.perf_counter()
    _answer(seconds, cells)
    return time.perf_counter() - started


def tune(cells: int, seconds: float) -> float:
    """Return the seconds that Ray Tune takes for `cells` trials of `seconds` each."""
    _ray()
    from ray import tune

    def trial(config: dict[str, Any]) -> dict[str, float]:
        _work(seconds)
        return {"done": 1.0}

    with tempfile.TemporaryDirectory(prefix="deltatune-plain-") as folder:
        tuner = tune.Tuner(
            tune.with_resources(trial, {"cpu": 1}),
            tune_config=tune.TuneConfig(num_samples=cells, reuse_actors=True),
            run_config=tune.RunConfig(storage_path=folder, verbose=0),
        )
        started = time.perf_counter()
        found = tuner.fit()
        taken = time.perf_counter() - started
    assert len(found) == cells
    assert not found.errors
    return taken


def _ray() -> Any:
    """Return Ray, started with this machine's CPUs."""
    import ray

    if not ray.is_initialized():
        ray.init(
            address="local",
            num_cpus=local_cpus(),
            include_dashboard=False,
            log_to_driver=False,
            logging_level="ERROR",
        )
    return ray


def _answer(seconds: float, calls: int) -> None:
    """Let one actor per CPU answer `calls` calls of `seconds` of work."""
    from ray.util import ActorPool

    ray = _ray()

    class Worker:
        def work(self, number: int) -> int:
            _work(seconds)
            return number

    remote = ray.remote(num_cpus=1)(Worker)
    pool = ActorPool([remote.remote() for _ in range(local_cpus())])
    assert len(list(pool.map_unordered(lambda actor, number: actor.work.remote(number), range(calls)))) == calls


def _work(seconds: float) -> None:
    until = time.perf_counter() + seconds
    while time.perf_counter() < until:
        pass


def measure(parts: Sequence[str], cells: int, seconds: float) -> dict[str, float]:
    """Return the figures of some parts, each from a new process, and the ideal wall time of the work."""
    found = {name: _in_a_process(name, cells, seconds) for name in parts}
    return found | {"ideal": cells * seconds / local_cpus()}


def _in_a_process(name: str, cells: int, seconds: float) -> float:
    command = [sys.executable, "-m", "benchmarks.plain_ray", "--part", name]
    command += ["--cells", str(cells), "--seconds", str(seconds)]
    return float(subprocess.run(command, stdout=subprocess.PIPE, text=True, check=True).stdout.split()[-1])


PARTS: dict[str, Callable[[int, float], float]] = {
    "start": lambda cells, seconds: start(),
    "actors": actors,
    "tune": tune,
}


def main() -> None:
    """Measure, and print a line a figure, or JSON."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("parts", nargs="*", metavar="PART", help=f"some of {', '.join(PARTS)}; default: all")
    parser.add_argument("--cells", type=int, default=1000)
    parser.add_argument("--seconds", type=float, default=0.05)
    parser.add_argument("--json", action="store_true")
    parser.add_argument("--part", choices=list(PARTS), help=argparse.SUPPRESS)
    asked = parser.parse_args()
    if unknown := set(asked.parts) - set(PARTS):
        parser.error(f"no part '{min(unknown)}': there are {', '.join(PARTS)}")
    prepare()
    if asked.part:
        print(PARTS[asked.part](asked.cells, asked.seconds))
        return
    found = measure(asked.parts or list(PARTS), asked.cells, asked.seconds)
    if asked.json:
        print(json.dumps(found | {"load": os.getloadavg()[0]}))
        return
    print("\n".join(f"{value:8.2f}  {name}" for name, value in found.items()))


if __name__ == "__main__":
    main()
