"""The compiled backward pass of the multilayer perceptron: the gradient from the errors of the output."""

from __future__ import annotations

import numpy as np

from trainables.networks.workspace import ERROR, IDENTITY, LEFT, PLACE, ROW, Workspace, errors_at, offsets
from trainables.numerics.jit import compiled
from trainables.numerics.matmul import F32, I64, column_sums, pack, padded, product, transpose
from trainables.numerics.simd import WIDTH
from trainables.numerics.tiles import MASK, STORE


@compiled
def _bias_gradient(n: int, e0: int, units: I64, b0: int, n_out: int, work: Workspace) -> None:
    """Compute the gradient of the bias at b0 from the errors at e0, whose columns are `units`."""
    rows, edge = padded(work.batch[0]), len(work.panel) // 2
    work.gradient[b0 : b0 + n_out] = 0.0
    for j in range(0, len(units), WIDTH):
        column_sums(n, work.errors, e0 + j * rows, work.panel, edge)
        for i in range(min(WIDTH, len(units) - j)):
            work.gradient[b0 + units[j + i]] = work.panel[edge + i]


@compiled
def _first_gradient(n_in: int, n: int, e0: int, units: I64, n_out: int, work: Workspace) -> None:
    """Compute the gradient of the first layer's weights: X_0 @ E_1, panel by panel, and transposed."""
    rows, edge = padded(work.batch[0]), len(work.panel) // 2
    left, row = offsets(work, LEFT), offsets(work, ROW)
    for k in range(n):
        left[k] = k // WIDTH * n_in * WIDTH + k % WIDTH
    if len(units) < n_out:
        work.gradient[: n_in * n_out] = 0.0
    for j in range(0, len(units), WIDTH):
        product(
            n_in, n, work.values, 0, WIDTH, left, work.errors, e0 + j * rows, row,
            work.panel, edge, row, STORE, work.panel, 0, units,
        )  # fmt: skip
        for i in range(min(WIDTH, len(units) - j)):
            w = units[j + i] * n_in
            for k in range(n_in):
                work.gradient[w + k] = work.panel[edge + k * WIDTH + i]


@compiled
def _gradient(
    w0: int, n_in: int, n_out: int, n: int, e0: int, units: I64, t0: int, inputs: I64, work: Workspace
) -> None:
    """Compute the gradient of the weights at w0 from the errors at e0 (`units`) and the values at t0 (`inputs`)."""
    rows, edge = padded(work.batch[0]), len(work.panel) // 2
    place, row = offsets(work, PLACE), offsets(work, ROW)
    if len(units) < n_out or len(inputs) < n_in:
        work.gradient[w0 : w0 + n_in * n_out] = 0.0
    for i in range(len(units)):
        place[i] = units[i] * n_in
    for j in range(0, len(inputs), WIDTH):
        columns = min(WIDTH, len(inputs) - j)
        direct = columns == WIDTH and len(inputs) == n_in
        for i in range(0, len(units), WIDTH):
            m = min(WIDTH, len(units) - i)
            if direct:
                product(
                    m, n, work.errors, e0 + i * rows, 1, row, work.errors, t0 + j * rows, row,
                    work.gradient, w0 + j, place[i:], STORE, work.panel, 0, units,
                )  # fmt: skip
                continue
            product(
                m, n, work.errors, e0 + i * rows, 1, row, work.errors, t0 + j * rows, row,
                work.panel, edge, row, STORE, work.panel, 0, units,
            )  # fmt: skip
            for r in range(m):
                w = w0 + place[i + r]
                for c in range(columns):
                    work.gradient[w + inputs[j + c]] = work.panel[edge + r * WIDTH + c]


@compiled
def _errors_below(
    parameters: F32, w0: int, n_in: int, n: int, e0: int, units: I64, t0: int, inputs: I64, work: Workspace
) -> None:
    """Compute the errors at t0 (`inputs`) from those at e0 (`units`), the weights at w0 and the ReLU."""
    rows, row = padded(work.batch[0]), offsets(work, ROW)
    for i in range(len(units)):
        offsets(work, PLACE)[i] = units[i] * n_in
    for j in range(0, len(inputs), WIDTH):
        columns = min(WIDTH, len(inputs) - j)
        if len(inputs) == n_in:
            pack(parameters, w0 + j, offsets(work, PLACE), len(units), columns, work.panel, 0)
        else:
            for k in range(len(units)):
                w = w0 + units[k] * n_in
                for c in range(columns):
                    work.panel[k * WIDTH + c] = parameters[w + inputs[j + c]]
                work.panel[k * WIDTH + columns : (k + 1) * WIDTH] = 0.0
        product(
            n, len(units), work.errors, e0, WIDTH, offsets(work, ERROR), work.panel, 0, row,
            work.errors, t0 + j * rows, row, MASK, work.errors, t0 + j * rows, units,
        )  # fmt: skip


@compiled
def backward(sizes: I64, parameters: F32, n: int, work: Workspace) -> None:
    """Compute `gradient` from E_L, after `forward` with the same n columns."""
    layers, rows = len(sizes) - 1, padded(work.batch[0])
    w0, e0, x0, unit0 = len(parameters), errors_at(sizes, work), int(np.sum(sizes)) * rows, int(np.sum(sizes))
    x0 -= sizes[-1] * rows
    unit0 -= sizes[-1]
    units = offsets(work, IDENTITY)[: sizes[-1]]
    for layer in range(layers - 1, -1, -1):
        n_in, n_out = sizes[layer], sizes[layer + 1]
        w0 -= (n_in + 1) * n_out
        x0 -= n_in * rows
        unit0 -= n_in
        _bias_gradient(n, e0, units, w0 + n_in * n_out, n_out, work)
        if layer == 0:
            _first_gradient(n_in, n, e0, units, n_out, work)
            break
        inputs = offsets(work, IDENTITY)[:n_in]
        if layer == layers - 1:
            inputs = work.active[unit0 : unit0 + work.counts[layer]]
        t0 = e0 - padded(n_in) * rows
        left = offsets(work, LEFT)
        for i in range(padded(len(inputs))):
            left[i] = inputs[min(i, len(inputs) - 1)] * WIDTH
        transpose(work.values, x0, left, n_in * WIDTH, len(inputs), padded(n), rows, work.errors, t0)
        _gradient(w0, n_in, n_out, n, e0, units, t0, inputs, work)
        _errors_below(parameters, w0, n_in, n, e0, units, t0, inputs, work)
        units, e0 = inputs, t0
