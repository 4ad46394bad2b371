"""The steps of the windy gridworld, and its exact model.

The order of operations in a step affects the results, so it is fixed: the chosen move or, with probability .25, a
random one of the four; this move and the wind of the old column are added; the sum is clipped to the grid.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array

from trainables.numerics.jit import compiled
from trainables.tasks.spec.family import Context
from trainables.tasks.spec.tabular_model import Dynamics, TransitionModel

KIND = 0
SIZE = 20
UP, DOWN, LEFT, RIGHT = range(4)
INTENDED = 0.75
"""Probability that the chosen move is executed; else a random one of the four, so the chosen one has .8125 in all."""
TIME_LIMIT = 200


@compiled
def land(state: int, move: int, parameters: NDArray[np.float64]) -> int:
    """Return the cell where an executed move ends. parameters: (1 + SIZE,), the goal, then the wind of each column."""
    row, column = state // SIZE, state % SIZE
    row -= int(parameters[1 + column])
    if move == UP:
        row -= 1
    elif move == DOWN:
        row += 1
    elif move == LEFT:
        column -= 1
    else:
        column += 1
    return min(max(row, 0), SIZE - 1) * SIZE + min(max(column, 0), SIZE - 1)


@compiled
def step(state: int, action: int, parameters: NDArray[np.float64], rng: np.random.Generator) -> tuple[int, float, bool]:
    """Take a step; return (next state, reward, terminated)."""
    move = action if rng.random() < INTENDED else int(rng.integers(0, 4))
    next_state = land(state, move, parameters)
    return next_state, -1.0, next_state == int(parameters[0])


def _cell(position: tuple[int, int]) -> int:
    row, column = position
    return row * SIZE + column


def dynamics(context: Context) -> Dynamics:
    """Return the sampled dynamics in this wind."""
    parameters = np.array([_cell(context["goal"]), *context["wind"]], dtype=np.float64)
    return Dynamics(KIND, parameters, _cell(context["start"]), SIZE * SIZE, 4, TIME_LIMIT)


def model(context: Context) -> TransitionModel:
    """Return the exact model: a move is executed with probability .8125 if it was chosen, else .0625."""
    dyn = dynamics(context)
    goal = _cell(context["goal"])
    rows, columns, probabilities = [], [], []
    for state in range(dyn.states):
        if state == goal:
            continue
        for action in range(4):
            for move in range(4):
                rows.append(state * 4 + action)
                columns.append(land(state, move, dyn.parameters))
                probabilities.append((1 - INTENDED) / 4 + (INTENDED if move == action else 0.0))
    transitions = coo_array((probabilities, (rows, columns)), shape=(dyn.states * 4, dyn.states)).tocsr()
    rewards = np.full((dyn.states, 4), -1.0)
    rewards[goal] = 0.0
    return TransitionModel(transitions, rewards, dyn.start, TIME_LIMIT)
