"""`python -m tests.simulation --seeds N` runs seeds, `--seed K` one of them again."""

from __future__ import annotations

import argparse
import gc
import logging
import os
import sys
import time
from collections import Counter

if os.environ.get("PYTHONHASHSEED") != "0":  # so that a seed is one run, and no other
    os.execve(
        sys.executable, [sys.executable, "-m", "tests.simulation", *sys.argv[1:]], os.environ | {"PYTHONHASHSEED": "0"}
    )

from tests.simulation import crash_points
from tests.simulation.mutants import MUTANTS
from tests.simulation.simulate import simulate


def main() -> None:
    """Run seeds and say what came of them."""
    parser = argparse.ArgumentParser(description="The real driver in virtual time")
    parser.add_argument("--seeds", type=int, default=1000, help="how many")
    parser.add_argument("--start", type=int, default=0, help="the first one")
    parser.add_argument("--seed", type=int, help="only this one")
    parser.add_argument("--crash-points", action="store_true", help="every crash point of a tiny sweep instead")
    parser.add_argument("--mutants", action="store_true", help="mistakes in the code instead, each until it is found")
    options = parser.parse_args()
    gc.set_threshold(100_000)  # most of what there is stays
    logging.getLogger("deltatune").addHandler(logging.NullHandler())
    if options.crash_points:
        tried = list(crash_points.every())
        wrong = [each for each in tried if each[1]]
        print(*wrong, f"{len(tried) - len(wrong)} of {len(tried)} crash points go on to the same tables", sep="\n")
        sys.exit(bool(wrong))
    if options.mutants:
        for mutant in MUTANTS:
            print(f"{mutant.what}: found by seed {mutant.caught_by(range(options.seeds))}", flush=True)
        return
    seeds = [options.seed] if options.seed is not None else range(options.start, options.start + options.seeds)
    began, injected, broken, lives, virtual = time.process_time(), Counter[str](), 0, 0, 0.0
    for seed in seeds:
        run = simulate(seed)
        injected += run.injected
        lives, virtual = lives + run.lives, virtual + run.seconds
        broken += bool(run.violations)
        for text in run.violations:
            print(f"seed {seed}: {text}", flush=True)
    seconds = time.process_time() - began
    print(f"{len(seeds)} seeds, {lives} lives of a driver, {virtual / 3600:.0f} hours of virtual time")
    each = ", ".join(f"{name} {count}" for name, count in sorted(injected.items()))
    print(f"{seconds:.0f} s of processor time; {sum(injected.values())} faults: {each}")
    print(f"{broken} seeds with violations")
    sys.exit(bool(broken))


if __name__ == "__main__":
    main()
