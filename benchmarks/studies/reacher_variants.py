"""Which Reacher the paper had: what doing nothing and two planners come to with and without control cost and gravity.

`python -m benchmarks.studies.reacher_variants` prints undiscounted returns of episodes, mean with a 95 % interval. Both
planners know the dynamics and plan anew in each step: `near` holds each action for two steps and then goes on, lets go
or brakes, over six steps; `far` pushes, coasts and brakes, over 24. The better of the two is a lower bound of what is
possible.
"""

from __future__ import annotations

import argparse
import math
from collections.abc import Callable, Sequence

import mujoco
import numpy as np

from trainables.tasks.builtin.reacher_env import TORQUES, DiscreteReacher

NOTHING, STEPS = 4, 50
Plan = tuple[tuple[int, int], ...]
"""(action, steps) one after the other."""
NEAR: tuple[Plan, ...] = tuple(((a, 2), (then, 4)) for a in range(9) for then in dict.fromkeys((a, NOTHING, 8 - a)))
FAR: tuple[Plan, ...] = (
    ((NOTHING, 24),),
    *(((a, hold), (NOTHING, 24 - hold)) for a in range(9) if a != NOTHING for hold in (1, 2)),
    *(
        ((a, hold), (NOTHING, coast), (8 - a, hold), (NOTHING, 24 - 2 * hold - coast))
        for a in range(9)
        if a != NOTHING
        for hold in (1, 2)
        for coast in (1, 3, 6, 10)
    ),
)
CASES = (("y_force", 0.0), ("y_force", 0.75), ("y_force", 1.0), ("gravity", 0.75), ("gravity", 1.0))


def build(feature: str, value: float, cost: float) -> DiscreteReacher:
    """Return the environment, without a time limit."""
    env = DiscreteReacher(value if feature == "y_force" else 0.0, cost)
    if feature == "gravity":
        env.model.opt.gravity[1] = value
    return env


def planned(env: DiscreteReacher, plans: Sequence[Plan]) -> int:
    """Return the first action of the plan with the largest sum of rewards; the simulator is left as it was."""
    data, model = env.data, env.model
    before = data.qpos.copy(), data.qvel.copy(), data.time
    tip, target = env._views[3], env._views[4]
    best, action = -math.inf, NOTHING
    for plan in plans:
        data.qpos[:], data.qvel[:], data.time = before
        total = 0.0
        for held, steps in plan:
            data.ctrl[:] = TORQUES[held]
            for _ in range(steps):
                mujoco.mj_step(model, data, env.frame_skip)
                apart = tip - target
                total += env._effort[held] - math.sqrt(float(apart.dot(apart)))
        if total > best:
            best, action = total, plan[0][0]
    data.qpos[:], data.qvel[:], data.time = before
    mujoco.mj_forward(model, data)
    return action


def returns(env: DiscreteReacher, choose: Callable[[DiscreteReacher], int], episodes: int) -> str:
    """Return the mean return of episodes 0, 1, ... with its 95 % interval as text."""
    found = []
    for seed in range(episodes):
        env.reset(seed=seed)
        found.append(sum(float(env.step(choose(env))[1]) for _ in range(STEPS)))
    half = 1.96 * float(np.std(found, ddof=1)) / math.sqrt(episodes)
    return f"{np.mean(found):.2f} +- {half:.2f}"


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--episodes", type=int, default=25, help="of `near`; 4 times as many of doing nothing")
    parser.add_argument("--far", type=int, default=6, help="episodes of `far`, two seconds each")
    given = parser.parse_args()
    print("| control cost | feature | nothing | near | far |\n|---|---|---|---|---|")
    for cost in (1.0, 0.0):
        for feature, value in CASES:
            env = build(feature, value, cost)
            still = returns(env, lambda env: NOTHING, 4 * given.episodes)
            near = returns(env, lambda env: planned(env, NEAR), given.episodes)
            far = returns(env, lambda env: planned(env, FAR), given.far)
            print(f"| {cost:g} | {feature}={value:g} | {still} | {near} | {far} |", flush=True)
            env.close()


if __name__ == "__main__":
    main()
