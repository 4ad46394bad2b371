"""Checks that source knowledge fits a task."""

from __future__ import annotations

import itertools

import numpy as np

from trainables.agents.registry import agent_named
from trainables.cell import Cell
from trainables.errors import InputError
from trainables.knowledge import Knowledge
from trainables.tasks.registry import parse_task
from trainables.tasks.shape import task_shape


def check_fit(cell: Cell, knowledge: Knowledge) -> None:
    """Raise InputError unless the arrays are finite and of the kind that the cell's agent learns on its task."""
    shape = task_shape(parse_task(cell.task))
    if agent_named(cell.agent).kind == "tabular":
        knowledge.q_table(shape)
        return
    arrays = knowledge.arrays
    if "sizes" not in arrays or "last" not in arrays or "best" not in arrays:
        raise InputError("the source is not the knowledge of a deep agent")
    sizes = arrays["sizes"]
    if sizes.dtype != np.int64 or sizes.ndim != 1 or (len(sizes) and (sizes < 1).any()):
        raise InputError("the source's layer sizes are not whole numbers above 0")
    if len(sizes) and (int(sizes[0]), int(sizes[-1])) != shape:
        raise InputError(f"the source's network is for {sizes[0]} inputs and {sizes[-1]} actions, its task has {shape}")
    count = int(sum(int(a + 1) * int(b) for a, b in itertools.pairwise(sizes)))
    for name in ("last", "best"):
        vector = arrays[name]
        if vector.dtype != np.float32 or vector.ndim != 1 or (len(sizes) and len(vector) != count):
            raise InputError(f"the source's '{name}' is not a vector of {count or 'its'} 32-bit parameters")
        if not np.isfinite(vector).all():
            raise InputError("the source's network holds a NaN or an infinity")
