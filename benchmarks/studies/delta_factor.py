"""How much of the advice delta's factor leaves, in its unit and without one, on all four deep tasks.

`python -m benchmarks.studies.delta_factor` trains a source on each task for some episodes, and `relative_es` with it on
the same task and on its targets. An ideal factor is 1 on the source's own task, and falls with the physics. Beside that
of `relative_es` stands the paper's exp(-max |delta|), at the same states: those where the advice acted.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from typing import Any

from trainables.cell import Cell, Source
from trainables.curve import EvalPoint
from trainables.numerics.threads import one_thread
from trainables.training.train import train

SOURCES: dict[str, tuple[int, str, tuple[str, ...]]] = {
    "cartpole": (250, "cartpole", ("cartpole:gravity=5x", "cartpole:gravity=7x", "cartpole:pole_length=4x")),
    "acrobot": (60, "acrobot", ("acrobot:link_mass=1.5", "acrobot:link_mass=2")),
    "lunar_lander": (100, "lunar_lander", ("lunar_lander:mass=0.75", "lunar_lander:mass=1.5")),
    "reacher": (
        200,
        "reacher:control_cost=0",
        ("reacher:gravity=1,control_cost=0", "reacher:gravity=5,control_cost=0"),
    ),
}
"""Family to the episodes of its source at `--scale 1`, the source task, and the targets."""
FLOORS = ["quantile", "state"]
QUICK: dict[str, Any] = {
    "learning_rate": 1e-3,
    "epsilon_decay": 20.0,
    "evaluation_episodes": 1,
    "target_update": 200,
}


def runs(family: str, scale: float, seed: int, floors: list[str]) -> Iterator[tuple[str, str, EvalPoint]]:
    """Yield (target, floor, the last point with advice) of relative_es on the source's own task and on the targets."""
    episodes, own, targets = SOURCES[family]
    settings = QUICK | {"episodes": max(20, round(scale * episodes))}
    settings["evaluate_every"] = settings["episodes"]
    cell = Cell.create("dqn", own, seed, settings)
    training = train(cell)
    list(training)
    knowledge = training.knowledge()
    source = Source(task=own, kind="learned", cell_id=cell.id, checkpoint="last")
    for floor in floors:
        for target in (own, *targets):
            given = settings | {"episodes": max(20, settings["episodes"] // 4), "floor": floor, "advice_fraction": 1.0}
            given["evaluate_every"] = given["episodes"]
            yield target, floor, list(train(Cell.create("relative_es", target, seed, given, source), knowledge))[-1]


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--tasks", nargs="+", choices=list(SOURCES), default=list(SOURCES), help="families (all)")
    parser.add_argument("--seeds", type=int, default=1, help="seeds (%(default)s)")
    parser.add_argument("--scale", type=float, default=1.0, help="share of the episodes (%(default)s)")
    parser.add_argument("--floors", nargs="+", choices=FLOORS, default=FLOORS, help="floors of relative_es (all)")
    given = parser.parse_args()
    one_thread()
    print("| task | floor | seed | paper's factor | own factor | max abs delta | floor | unit | median sample |")
    print("|---|---|---|---|---|---|---|---|---|")
    for family in given.tasks:
        for seed in range(given.seeds):
            for target, floor, point in runs(family, given.scale, seed, given.floors):
                found = point.statistics
                names = "advised_paper_factor", "advised_factor", "advised_delta", "delta_floor", "advice_range"
                numbers = [f"{found[name]:.3f}" for name in (*names, "delta_sample_median")]
                print(f"| {target} | {floor} | {seed} | {' | '.join(numbers)} |", flush=True)


if __name__ == "__main__":
    main()
