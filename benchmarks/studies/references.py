"""The two reference values of tasks for normalised scores, as YAML: `python -m benchmarks.studies.references TASK...`.

0 is a policy that acts at random. 1 is a solution: the task's threshold (`solved_at`), or on tabular tasks the optimal
policy. Both are undiscounted returns, as greedy evaluation has them.
"""

from __future__ import annotations

import argparse

import numpy as np

from trainables.delta.exact import exact_q
from trainables.evaluation import expected_return
from trainables.tasks.make import make_env
from trainables.tasks.registry import model_of, parse_task
from trainables.tasks.spec.tabular_model import TransitionModel

GAMMA = 0.99


def random_return(task: str, episodes: int) -> float:
    """Return the mean undiscounted return of uniformly random actions: exact on tabular tasks, else of episodes."""
    parsed = parse_task(task)
    if parsed.tabular:
        return _expected_random(model_of(task))
    env, rng, total = make_env(parsed), np.random.default_rng(0), 0.0
    for episode in range(episodes):
        env.reset(seed=episode)
        ended = False
        while not ended:
            _, reward, terminated, truncated, _ = env.step(int(rng.integers(env.action_space.n)))
            total, ended = total + float(reward), terminated or truncated
    env.close()
    return total / episodes


def _expected_random(model: TransitionModel) -> float:
    states, actions = model.rewards.shape
    now, total = np.zeros(states), 0.0
    now[model.start] = 1.0
    for _ in range(model.time_limit):
        mass = np.repeat(now / actions, actions)
        total += float(mass @ model.rewards.ravel())
        now = model.transitions.T @ mass
    return total


def solution(task: str) -> float:
    """Return the return that counts as 1."""
    family = parse_task(task).family
    if family.solved_at is not None:
        return family.solved_at
    model = model_of(task)
    return expected_return(model, exact_q(task, GAMMA).argmax(axis=1), GAMMA)[0]


def main() -> None:
    """Print a line per task."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("tasks", nargs="+")
    parser.add_argument("--episodes", type=int, default=500)
    arguments = parser.parse_args()
    print("normalise:")
    for task in arguments.tasks:
        low, high = random_return(task, arguments.episodes), solution(task)
        print(f'  "{parse_task(task).name}": [{low:.4g}, {high:.4g}]', flush=True)


if __name__ == "__main__":
    main()
