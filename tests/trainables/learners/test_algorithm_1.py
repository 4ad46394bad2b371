"""The episode loop against the paper's Algorithm 1, written down once more in the plainest way.

Without exploration the only randomness is the environment's, so every bit of the tables can be compared.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest

from tests.trainables.small_cells import GAMMA, REVERSED, small_cell
from trainables.cell import Cell
from trainables.delta.exact import exact_q
from trainables.knowledge import Knowledge
from trainables.numerics.rng import stream
from trainables.tasks.registry import parse_task
from trainables.tasks.tabular_env import TabularEnv
from trainables.training.train import train

SMALL = "windy_gridworld:wind=small"
CHAIN = "supply_chain:demand_mean=5"


@dataclass
class Outcome:
    """What the plain loop ends with."""

    q: np.ndarray
    delta: np.ndarray
    steps: int
    open_steps: int
    flips: int


def _algorithm_1(cell: Cell, q_src: np.ndarray, threshold: float, warm: bool = False) -> Outcome:
    """Lines 1 to 12, epsilon 0; a threshold below 0 never opens the gate: Q-learning. warm: Q_trg starts at Q_src."""
    values, dynamics = cell.hyperparameters, parse_task(cell.task).dynamics()
    env = TabularEnv(dynamics)
    end = Outcome(q_src * warm, np.zeros_like(q_src), 0, 0, 0)
    rng = stream(cell.seed, "training_env", cell.task)
    for _ in range(int(values["episodes"])):
        state, _ = env.reset()
        env.np_random = rng
        for t in range(200):
            gate_open = np.abs(end.delta).max() <= threshold
            action = int((q_src if gate_open else end.q)[state].argmax())
            after, reward, terminated, _, _ = env.step(action)
            v_src = 0.0 if terminated else q_src[after].max()
            error = reward + GAMMA * v_src - q_src[state, action] - end.delta[state, action]
            end.delta[state, action] += values.get("delta_learning_rate", 0.0) * error
            cut = terminated or (t == 199 and values["truncation"] == "terminal")
            target = reward + (0.0 if cut else GAMMA * end.q[after].max())
            end.q[state, action] += values["learning_rate"] * (target - end.q[state, action])
            end.steps, end.open_steps = end.steps + 1, end.open_steps + gate_open
            end.flips += (np.abs(end.delta).max() <= threshold) != gate_open
            state = after
            if terminated:
                break
    return end


@pytest.mark.parametrize("truncation", ["terminal", "bootstrap"])
@pytest.mark.parametrize(("task", "episodes", "threshold"), [(REVERSED, 40, 3.0), (SMALL, 30, 2.0), (CHAIN, 4, 1.0)])
def test_delta_gate_is_algorithm_1_bit_for_bit(task, episodes, threshold, truncation) -> None:
    cell = small_cell(
        "delta_gate",
        task,
        episodes=episodes,
        evaluate_every=episodes,
        threshold=threshold,
        truncation=truncation,
        epsilon_start=0.0,
        delta_learning_rate=0.3,
    )
    # A source that is off by 1 everywhere: at the goal, too, where V_src must not count.
    q_src = exact_q(parse_task(task).family.name, GAMMA) + 1.0
    plain = _algorithm_1(cell, q_src, threshold)
    training = train(cell, Knowledge({"q": q_src}))
    last = list(training)[-1]
    assert 0 < plain.open_steps < plain.steps
    assert (training.knowledge().arrays["q"] == plain.q).all()
    assert last.step == plain.steps
    assert last.statistics == {
        "max_abs_delta": np.abs(plain.delta).max(),
        "pairs_over_threshold": np.count_nonzero(np.abs(plain.delta) > threshold),
        "gate_open": float(np.abs(plain.delta).max() <= threshold),
        "gate_open_share": plain.open_steps / plain.steps,
        "gate_flips": plain.flips,
    }


@pytest.mark.parametrize(("task", "episodes"), [(REVERSED, 60), (CHAIN, 4)])
def test_q_learning_is_eq_1_bit_for_bit(task: str, episodes: int) -> None:
    cell = small_cell("q_learning", task, episodes=episodes, evaluate_every=episodes, epsilon_start=0.0)
    plain = _algorithm_1(cell, np.zeros_like(exact_q(parse_task(task).family.name, GAMMA)), -1.0)
    training = train(cell)
    assert list(training)[-1].step == plain.steps
    assert (training.knowledge().arrays["q"] == plain.q).all()


@pytest.mark.parametrize(("task", "episodes"), [(SMALL, 30), (CHAIN, 4)])
def test_q_warm_start_is_eq_1_from_q_src_and_estimates_delta_against_the_source_as_it_was(task, episodes) -> None:
    cell = small_cell("q_warm_start", task, episodes=episodes, evaluate_every=episodes, epsilon_start=0.0)
    plain = _algorithm_1(cell, exact_q(parse_task(task).family.name, GAMMA), -1.0, warm=True)
    training = train(cell)
    last = list(training)[-1]
    assert (training.knowledge().arrays["q"] == plain.q).all()
    assert last.statistics == {"max_abs_delta": np.abs(plain.delta).max()}
