"""Windy Gridworld, 20 x 20 (paper, Appendix B and Table 2).

The order inside a step decides the results, so it is fixed: the chosen move or, with probability .25, one of the
four at random; that move and the wind of the column that was left are added; then one clip to the grid.
"""

from __future__ import annotations

import hashlib
import re

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array

from trainables.errors import InputError
from trainables.numerics.jit import compiled
from trainables.tasks.spec.family import Context, ContextFeature, TaskFamily, integers
from trainables.tasks.spec.tabular_model import Dynamics, TransitionModel

KIND = 0
SIZE = 20
UP, DOWN, LEFT, RIGHT = range(4)
INTENDED = 0.75
"""Probability that the chosen move is executed; else one of the four is, so the chosen one has .8125."""
TIME_LIMIT = 200

SOURCE_WIND = (0, 0, 0, 1, 1, 1, 2, 2, 1, 0) * 2
WINDS: dict[str, tuple[int, ...]] = {
    "source": SOURCE_WIND,
    "small": (0, 0, -1, 1, 1, 1, 2, 2, 1, 0, 0, 0, 0, 1, 1, 1, 2, 2, 1, 0),
    "reversed": tuple(-strength for strength in SOURCE_WIND),
    "additional_1": (0, 1, 1, 1, 2, 1, -1, 1, -1, 0) * 2,
    "additional_2": (0, 1, -1, 1, 1, 1, -2, 2, 1, 0) * 2,
}
"""Upward wind of each column (Table 2; the source is the negative of the reversed one)."""


@compiled
def land(state: int, move: int, parameters: NDArray[np.float64]) -> int:
    """The cell where an executed move ends. parameters: (1 + SIZE,), the goal, then the wind of each column."""
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
    """One step: (next state, reward, terminated)."""
    move = action if rng.random() < INTENDED else int(rng.integers(0, 4))
    next_state = land(state, move, parameters)
    return next_state, -1.0, next_state == int(parameters[0])


_columns = integers(SIZE, -19, 19)


def _cell(position: tuple[int, int]) -> int:
    row, column = position
    return row * SIZE + column


def dynamics(context: Context) -> Dynamics:
    """The sampled dynamics in this wind."""
    parameters = np.array([_cell(context["goal"]), *context["wind"]], dtype=np.float64)
    return Dynamics(KIND, parameters, _cell(context["start"]), SIZE * SIZE, 4, TIME_LIMIT)


def model(context: Context) -> TransitionModel:
    """The exact model: each move's landing cell with probability .8125 if chosen, .0625 if not."""
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


def _wind(text: str) -> tuple[int, ...]:
    """A wind as written, or random-N: number N of the random ones, each column one of -2..2, the same everywhere."""
    if re.fullmatch(r"random-\d{1,9}", text) is None:
        return _columns(text)
    digest = hashlib.sha256(text.encode()).digest()
    return tuple(byte % 5 - 2 for byte in digest[:SIZE])


def _check(context: Context) -> None:
    if context["start"] == context["goal"]:
        raise InputError(f"windy_gridworld: start and goal must differ (both are {list(context['start'])})")


FAMILY = TaskFamily(
    name="windy_gridworld",
    description="20 x 20 grid with a wind per column; -1 a step until the goal, 200 steps at most",
    features=(
        ContextFeature("wind", SOURCE_WIND, "upward wind of each of the 20 columns, or random-N", _wind, WINDS),
        ContextFeature("start", (3, 0), "start [row,column], row 0 at the top", integers(2, 0, SIZE - 1)),
        ContextFeature("goal", (17, 14), "goal [row,column]", integers(2, 0, SIZE - 1)),
    ),
    defaults={"episodes": 5000, "threshold": 10.0, "delta_learning_rate": 0.05, "truncation": "bootstrap"},
    targets=tuple(f"windy_gridworld:wind={name}" for name in WINDS if name != "source"),
    dynamics=dynamics,
    model=model,
    check=_check,
)
