"""Matrix products of 32-bit floats for the compiled learner, with the same bits on every machine.

Each element of a product is one chain of fused multiply-adds in the order of k, whatever the vector width and the
number of cores of the machine, so a result never depends on a BLAS library's choice of kernel.

The right factor and the result are in panels of WIDTH columns: element (i, j) of a matrix of m rows is at
(j // WIDTH) * m * WIDTH + i * WIDTH + j % WIDTH. All arrays are flat; offsets are in elements.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from trainables.numerics.jit import compiled
from trainables.numerics.simd import (
    LANES,
    ROWS,
    WIDTH,
    WORD,
    copy_rows,
    dots1,
    dots8,
    lane_sums,
    squares1,
    squares8,
    transpose_block,
)
from trainables.numerics.tiles import tile, tile1, tile2, tile4

F32 = NDArray[np.float32]
I64 = NDArray[np.int64]


@compiled
def padded(count: int) -> int:
    """Return the number of columns of the panels for `count` columns."""
    return (count + WIDTH - 1) // WIDTH * WIDTH


@compiled
def product(
    m: int, k: int, a: F32, a0: int, a_row: int, a_at: I64, b: F32, b0: int, b_at: I64, c: F32, c0: int, c_at: I64,
    finish: int, other: F32, other0: int, alive: I64,
) -> None:  # fmt: skip
    """Compute C (m, WIDTH) = A (m, k) @ B (k, WIDTH) for k >= 1; see `tiles` for the offsets of the m rows."""
    i = 0
    while m - i >= ROWS:
        tile(a, a0 + i * a_row, a_row, a_at, b, b0, b_at, k, c, c0, c_at, i, finish, other, other0, alive)
        i += ROWS
    if m - i >= 4:
        tile4(a, a0 + i * a_row, a_row, a_at, b, b0, b_at, k, c, c0, c_at, i, finish, other, other0, alive)
        i += 4
    if m - i >= 2:
        tile2(a, a0 + i * a_row, a_row, a_at, b, b0, b_at, k, c, c0, c_at, i, finish, other, other0, alive)
        i += 2
    if m - i >= 1:
        tile1(a, a0 + i * a_row, a_row, a_at, b, b0, b_at, k, c, c0, c_at, i, finish, other, other0, alive)


@compiled
def pack(a: F32, a0: int, a_at: I64, k: int, columns: int, panel: F32, p0: int) -> None:
    """Copy `columns` elements of each of the k rows at a0 + a_at to the panel (k, WIDTH), padded with zeros."""
    if columns == WIDTH and k:
        copy_rows(a, a0, a_at, k, panel, p0)
        return
    for i in range(k):
        row, source = p0 + i * WIDTH, a0 + a_at[i]
        for j in range(columns):
            panel[row + j] = a[source + j]
        panel[row + columns : row + WIDTH] = 0.0


@compiled
def transpose(a: F32, a0: int, a_at: I64, step: int, columns: int, used: int, rows: int, b: F32, b0: int) -> None:
    """Write the first `used` elements (a multiple of WIDTH) of A's rows as the columns of B (rows, columns).

    Row j of A is in pieces of WIDTH elements, the first at a0 + a_at[j] and the others `step` apart. a_at has an offset
    for each column of B's panels; beyond `columns` it may be that of any row.
    """
    for j in range(0, padded(columns), WORD):
        panel = b0 + j // WIDTH * rows * WIDTH + j % WIDTH
        for i in range(0, used, WORD):
            transpose_block(a, a0 + i // WIDTH * step + i % WIDTH, a_at, j, b, panel + i * WIDTH, WIDTH)


@compiled
def column_sums(rows: int, a: F32, a0: int, c: F32, c0: int) -> None:
    """Sum the columns of a panel (rows, WIDTH), in the order of `dots` with a vector of ones."""
    chunks = rows // LANES
    if chunks:
        lane_sums(a, a0, WIDTH, chunks, c, c0)
    else:
        c[c0 : c0 + WIDTH] = 0.0
    for row in range(chunks * LANES, rows):
        for j in range(WIDTH):
            c[c0 + j] += a[a0 + row * WIDTH + j]


@compiled
def dots(rows: int, length: int, a: F32, a0: int, a_row: int, b: F32, b0: int, c: F32, c0: int) -> None:
    """Compute C (rows,) = A (rows, length) @ b (length,), with the rows of A contiguous."""
    chunks = length // LANES
    done, i = chunks * LANES, 0
    if chunks == 0:
        c[c0 : c0 + rows] = 0.0
    else:
        while rows - i >= 8:
            dots8(a, a0 + i * a_row, a_row, b, b0, chunks, c, c0 + i)
            i += 8
        while rows - i >= 1:
            dots1(a, a0 + i * a_row, a_row, b, b0, chunks, c, c0 + i)
            i += 1
    for row in range(rows if done < length else 0):
        total = c[c0 + row]
        for k in range(done, length):
            total += a[a0 + row * a_row + k] * b[b0 + k]
        c[c0 + row] = total


@compiled
def norm(a: F32) -> float:
    """Return the square root of the sum of squares, in eight chains of LANES sums each."""
    part = len(a) // (8 * LANES) * LANES
    sums = np.zeros(9, np.float32)
    if part:
        squares8(a, 0, part, a, 0, part // LANES, sums, 0)
    rest = (len(a) - 8 * part) // LANES
    if rest:
        squares1(a, 8 * part, 0, a, 0, rest, sums, 8)
    for i in range(8 * part + rest * LANES, len(a)):
        sums[8] += a[i] * a[i]
    total = 0.0
    for i in range(9):
        total += sums[i]
    return math.sqrt(total)
