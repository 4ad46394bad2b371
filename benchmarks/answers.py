"""Response times of the commands that train nothing, relative to importing numpy, yaml and typer.

    python -m benchmarks.answers [--rounds 7] [--json]

Each round runs the reference and every command once, in turn, in a folder with a sweep in it. The ratios are those of
the fastest runs: of wall time, and of processor time, which a busy machine disturbs less. The goal is at most 2.5.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from orchestrator.results.sweep_folder import Results
from search_spaces.loading import load

YARDSTICK = ("-c", "import numpy, yaml, typer")

COMMANDS = {
    "status": ("status",),
    "status demo": ("status", "demo"),
    "tasks": ("tasks",),
    "agents": ("agents",),
    "spaces": ("spaces",),
    "sweep --help": ("sweep", "--help"),
    "refused": ("sweep", "demo", "--set", "episode=5"),
}


def seconds(words: tuple[str, ...], folder: Path) -> tuple[float, float]:
    """Return the wall time and the processor time of one run of Python with `words`."""
    before, started = os.times(), time.perf_counter()
    subprocess.run([sys.executable, *words], cwd=folder, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    wall, after = time.perf_counter() - started, os.times()
    return wall, after.children_user + after.children_system - before.children_user - before.children_system


def measure(rounds: int, folder: Path) -> dict[str, tuple[float, float]]:
    """Return the fastest (wall, processor) seconds of the reference ('') and of each command."""
    words = {"": YARDSTICK} | {name: ("-m", "deltatune", *command) for name, command in COMMANDS.items()}
    runs: dict[str, list[tuple[float, float]]] = {name: [] for name in words}
    for _ in range(rounds):
        for name, command in words.items():
            runs[name].append(seconds(command, folder))
    return {name: (min(wall for wall, _ in times), min(cpu for _, cpu in times)) for name, times in runs.items()}


def main() -> None:
    """Print the table, or JSON."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rounds", type=int, default=7)
    parser.add_argument("--json", action="store_true")
    given = parser.parse_args()
    with tempfile.TemporaryDirectory() as name:
        demo = load("demo")
        Results.create(Path(name) / "results", "demo", demo)
        fastest = measure(given.rounds, Path(name))
    wall, cpu = fastest.pop("")
    rows = [
        {"command": name, "seconds": mine[0], "ratio": mine[0] / wall, "cpu_ratio": mine[1] / cpu}
        for name, mine in fastest.items()
    ]
    if given.json:
        print(json.dumps({"yardstick_seconds": wall, "commands": rows}, indent=1))
        return
    print(f"python -c 'import numpy, yaml, typer': {wall:.2f} s, {cpu:.2f} s of processor time\n")
    print(f"{'deltatune ...':<16}{'seconds':>8}{'ratio':>8}{'of processor time':>20}")
    for row in rows:
        print(f"{row['command']:<16}{row['seconds']:>8.2f}{row['ratio']:>8.2f}{row['cpu_ratio']:>20.2f}")


if __name__ == "__main__":
    main()
