"""Where the time of `deltatune sweep demo` goes, from its first instruction on: `python -m benchmarks.demo [--json]`.

Warm: a tiny sweep before it has compiled the kernels and filled the caches of the disk. Seconds of wall time.

    ray        interpreter, imports, planning, and starting Ray
    worker     until the first worker has imported what it needs
    first cell until the first record is on disk
    source, transfer  the rest of stage 1, and stage 2 with what lies between
    end        Ray's end, tables, figures, report, and the end of MLflow
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import tempfile
import threading
import time
from pathlib import Path
from typing import Any

WARM = ("--seeds", "1", "--set", "episodes=20", "--name", "warm")
MARKS = (
    ("ray", "source: ", "cells to run"),
    ("worker", "a worker has started", ""),
    ("source", "transfer: ", "cells to run"),
    ("transfer", "transfer: ", " 0 running"),
)
"""The phase that a line of the log ends: how it is told."""


def measure(extra: tuple[str, ...] = ()) -> dict[str, Any]:
    """Run the demo, and return the seconds of each phase, `wall`, `ideal` (training over workers) and its share."""
    with tempfile.TemporaryDirectory(prefix="deltatune-demo-") as name:
        storage = Path(name)
        command = [sys.executable, "-m", "deltatune", "-v", "sweep", "demo", "--storage", name, "--json", *extra]
        subprocess.run([*command, *WARM], capture_output=True, check=True)
        started = time.monotonic()
        with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
            assert process.stdout is not None
            ends: dict[str, float] = {}
            followers = [
                threading.Thread(target=_follow, args=(process, ends)),
                threading.Thread(target=_first_record, args=(process, storage / "demo" / "records", ends)),
            ]
            for follower in followers:
                follower.start()
            told = json.loads(process.stdout.read())
            for follower in followers:
                follower.join()
        ends["end"] = time.monotonic()
    return _phases(started, ends) | _shares(ends["end"] - started, told["tally"])


def _follow(process: subprocess.Popen[str], ends: dict[str, float]) -> None:
    """Note when the log tells the end of a phase."""
    assert process.stderr is not None
    for line in process.stderr:
        for phase, begin, end in MARKS:
            if phase not in ends and begin in line and end in line:
                ends[phase] = time.monotonic()


def _first_record(process: subprocess.Popen[str], records: Path, ends: dict[str, float]) -> None:
    while process.poll() is None:
        if any(path.stat().st_size for path in records.glob("*")):
            ends["first cell"] = time.monotonic()
            return
        time.sleep(0.02)


def _phases(started: float, ends: dict[str, float]) -> dict[str, float]:
    phases, before = {}, started
    for phase, end in sorted(ends.items(), key=lambda item: item[1]):
        phases[phase], before = round(end - before, 2), end
    return {"until the first cell": round(ends["first cell"] - started, 2), **phases}


def _shares(wall: float, tally: dict[str, Any]) -> dict[str, float]:
    ideal = tally["training_seconds"] / tally["workers"]
    return {"wall": round(wall, 2), "ideal": round(ideal, 2), "training": round(ideal / wall, 3)}


def main() -> None:
    """Measure, and print a line a phase, or JSON."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--json", action="store_true")
    parser.add_argument("extra", nargs="*", help="options of the sweep, after --: -- --no-mlflow")
    asked = parser.parse_args()
    found = measure(tuple(asked.extra))
    print(json.dumps(found) if asked.json else "\n".join(f"{value:8.2f}  {name}" for name, value in found.items()))


if __name__ == "__main__":
    main()
