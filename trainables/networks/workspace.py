"""The workspace for one pass of a batch through a multilayer perceptron, and the layout of its matrices.

Layers l = 0 (the input) to L (the output) have values X_l (n_l, batch), and errors E_l = d loss / d pre-activation,
transposed, (batch, n_l). The errors of a hidden layer only cover units that were active for some sample of the batch,
since those of the others are 0.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from trainables.numerics.jit import compiled
from trainables.numerics.matmul import F32, I64, padded
from trainables.numerics.simd import MAX_WIDTH, WIDTH


class Workspace(NamedTuple):
    """Buffers for one pass over a batch. Matrices are in the panels of `matmul`, one layer after the other."""

    values: F32
    """X_0, ..., X_L, columns padded to whole panels."""
    errors: F32
    """E_1, ..., E_L, rows padded to whole panels. In the backward pass each overwrites X_l transposed."""
    gradient: F32
    """d loss / d parameters."""
    panel: F32
    """One panel of a right factor; one of a result."""
    active: I64
    """Active units of each layer, ascending, as long as the layer."""
    counts: I64
    """Number of active units of each layer."""
    lists: I64
    """`LISTS` lists of offsets, each as long as the longest layer or the batch, padded."""
    batch: I64
    """(1,): the largest batch."""


LISTS = 6
IDENTITY, ROW, ERROR, LEFT, RIGHT, PLACE = range(LISTS)
"""The lists of offsets: k; k WIDTH; that of column k of the errors; and three that each product fills."""


def parameter_count(sizes: I64) -> int:
    """Return the number of weights and biases of a network with these layer sizes, input first."""
    return int(np.sum((sizes[:-1] + 1) * sizes[1:]))


def aligned(count: int) -> F32:
    """Return zeros that start at a cache line."""
    raw = np.zeros(count + 16, np.float32)
    first = (-raw.ctypes.data // 4) % 16
    return raw[first : first + count]


def workspace(sizes: I64, batch: int) -> Workspace:
    """Return a workspace for batches of up to `batch`."""
    columns, units = _whole(batch), sum(_whole(int(size)) for size in sizes[1:])
    longest = max(columns, *(_whole(int(size)) for size in sizes))
    work = Workspace(
        values=aligned(int(sizes.sum()) * columns),
        errors=aligned(units * columns),
        gradient=aligned(parameter_count(sizes)),
        panel=aligned(2 * longest * MAX_WIDTH),
        active=np.zeros(int(sizes.sum()), np.int64),
        counts=np.zeros(len(sizes), np.int64),
        lists=np.zeros(LISTS * longest, np.int64),
        batch=np.array([batch]),
    )
    _fill_lists(work)
    return work


def _whole(count: int) -> int:
    return -(-count // MAX_WIDTH) * MAX_WIDTH


@compiled
def offsets(work: Workspace, which: int) -> I64:
    """Return one of the lists."""
    longest = len(work.lists) // LISTS
    return work.lists[which * longest : (which + 1) * longest]


@compiled
def _fill_lists(work: Workspace) -> None:
    """Fill the lists that never change. Compiled, since kernels of a shared cache may have another width."""
    rows = padded(work.batch[0])
    identity, row, error = offsets(work, IDENTITY), offsets(work, ROW), offsets(work, ERROR)
    for k in range(len(identity)):
        identity[k] = k
        row[k] = k * WIDTH
        error[k] = k // WIDTH * rows * WIDTH + k % WIDTH


@compiled
def errors_at(sizes: I64, work: Workspace) -> int:
    """Return the offset of E_L."""
    at = 0
    for layer in range(1, len(sizes) - 1):
        at += padded(sizes[layer]) * padded(work.batch[0])
    return at
