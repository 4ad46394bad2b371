"""Matrix products of 32-bit floats for the compiled learner, with the same bits on every machine.

Each element of a product is one chain of fused multiply-adds in the order of k, whatever the width of the
machine's vectors and the number of its cores, so a result never depends on a BLAS library's choice of kernel.
All matrices lie in flat arrays and are named by an offset and two strides, counted in elements.
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
    copy_panel,
    dots1,
    dots8,
    tile1,
    tile2,
    tile4,
    tile8,
    transpose_block,
)

F32 = NDArray[np.float32]


@compiled
def dots(rows: int, length: int, a: F32, a0: int, a_row: int, b: F32, b0: int, c: F32, c0: int) -> None:
    """C (rows,) = A (rows, length) @ b (length,), with the rows of A contiguous."""
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
    """The square root of the sum of squares, in eight chains of LANES sums each."""
    part = len(a) // (8 * LANES) * LANES
    sums = np.zeros(9, np.float32)
    for i in range(8 if part else 0):
        dots1(a, i * part, 0, a, i * part, part // LANES, sums, i)
    rest = len(a) - 8 * part
    dots(1, rest, a, 8 * part, 0, a, 8 * part, sums, 8)
    total = 0.0
    for i in range(9):
        total += sums[i]
    return math.sqrt(total)


@compiled
def _pack(b: F32, b0: int, b_k: int, b_col: int, k: int, columns: int, panel: F32) -> None:
    """Copy B (k, columns) into the panel (k, WIDTH), zeros to its right."""
    blocks = 0
    if columns < WIDTH:
        panel[: k * WIDTH] = 0.0
    elif b_col == 1:
        copy_panel(b, b0, b_k, panel, k)
        return
    elif b_k == 1:
        blocks = k // WORD
        for block in range(blocks):
            for j in range(0, WIDTH, WORD):
                at = block * WORD
                transpose_block(b, b0 + at + j * b_col, b_col, panel, at * WIDTH + j, WIDTH)
    for i in range(blocks * WORD, k):
        for j in range(columns):
            panel[i * WIDTH + j] = b[b0 + i * b_k + j * b_col]


@compiled
def _column(m: int, k: int, a: F32, a0: int, a_row: int, a_k: int, panel: F32, c: F32, c0: int, c_row: int) -> None:
    """C (m, WIDTH) = A (m, k) @ panel (k, WIDTH)."""
    i = 0
    while m - i >= 8 and ROWS >= 8:
        tile8(a, a0 + i * a_row, a_row, a_k, panel, 0, k, c, c0 + i * c_row, c_row)
        i += 8
    while m - i >= 4:
        tile4(a, a0 + i * a_row, a_row, a_k, panel, 0, k, c, c0 + i * c_row, c_row)
        i += 4
    if m - i >= 2:
        tile2(a, a0 + i * a_row, a_row, a_k, panel, 0, k, c, c0 + i * c_row, c_row)
        i += 2
    if m - i == 1:
        tile1(a, a0 + i * a_row, a_row, a_k, panel, 0, k, c, c0 + i * c_row, c_row)


@compiled
def matmul(
    m: int,
    n: int,
    k: int,
    a: F32,
    a0: int,
    a_row: int,
    a_k: int,
    b: F32,
    b0: int,
    b_k: int,
    b_col: int,
    c: F32,
    c0: int,
    c_row: int,
    c_col: int,
    scratch: F32,
) -> None:
    """C (m, n) = A (m, k) @ B (k, n). scratch: at least (k + max(m, n)) * MOST_WIDTH floats."""
    if n < m and n < WIDTH:  # full panels of A transposed are less work than a panel of B that is mostly empty
        m, n = n, m
        a, a0, a_row, a_k, b, b0, b_k, b_col = b, b0, b_col, b_k, a, a0, a_k, a_row
        c_row, c_col = c_col, c_row
    edge = k * WIDTH
    for j in range(0, n, WIDTH):
        columns = min(WIDTH, n - j)
        _pack(b, b0 + j * b_col, b_k, b_col, k, columns, scratch)
        if columns == WIDTH and c_col == 1:
            _column(m, k, a, a0, a_row, a_k, scratch, c, c0 + j, c_row)
        else:
            _column(m, k, a, a0, a_row, a_k, scratch, scratch, edge, WIDTH)
            for at in range(columns):
                for i in range(m):
                    c[c0 + i * c_row + (j + at) * c_col] = scratch[edge + i * WIDTH + at]
