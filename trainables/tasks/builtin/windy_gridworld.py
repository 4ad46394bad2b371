"""Windy Gridworld, 20 x 20 (paper, Appendix B and Table 2): the task's features. Light to import."""

from __future__ import annotations

import hashlib
import re
from typing import TYPE_CHECKING

from trainables.errors import InputError
from trainables.tasks.spec.family import Context, ContextFeature, TaskFamily, integers

if TYPE_CHECKING:
    from trainables.tasks.spec.tabular_model import Dynamics, TransitionModel

SOURCE_WIND = (0, 0, 0, 1, 1, 1, 2, 2, 1, 0) * 2
SIZE = len(SOURCE_WIND)
"""Number of columns and of rows."""
WINDS: dict[str, tuple[int, ...]] = {
    "source": SOURCE_WIND,
    "small": (0, 0, -1, 1, 1, 1, 2, 2, 1, 0, 0, 0, 0, 1, 1, 1, 2, 2, 1, 0),
    "reversed": tuple(-strength for strength in SOURCE_WIND),
    "additional_1": (0, 1, 1, 1, 2, 1, -1, 1, -1, 0) * 2,
    "additional_2": (0, 1, -1, 1, 1, 1, -2, 2, 1, 0) * 2,
}
"""Upward wind of each column (Table 2; the source is the negative of the reversed one)."""

_columns = integers(SIZE, -19, 19)


def _dynamics(context: Context) -> Dynamics:
    from trainables.tasks.builtin.windy_gridworld_model import dynamics

    return dynamics(context)


def _model(context: Context) -> TransitionModel:
    from trainables.tasks.builtin.windy_gridworld_model import model

    return model(context)


def _wind(text: str) -> tuple[int, ...]:
    """Return the wind of a list, or of random-N: number N of fixed random winds, each column from -2 to 2."""
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
    dynamics=_dynamics,
    model=_model,
    check=_check,
)
