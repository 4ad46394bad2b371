"""The compiled arithmetic of a ReLU multilayer perceptron: its outputs, and one training step.

Parameters are in the order of torch's `nn.Sequential` of `nn.Linear`: W1 (n1, n0), b1 (n1), W2 (n2, n1), ... .
Reductions run in a fixed order, so results do not depend on the machine (see `matmul`).
"""

from __future__ import annotations

import numpy as np

from trainables.networks.adam import adam
from trainables.networks.backward import backward
from trainables.networks.workspace import IDENTITY, LEFT, RIGHT, ROW, Workspace, errors_at, offsets
from trainables.numerics.jit import compiled
from trainables.numerics.matmul import F32, I64, dots, pack, padded, product
from trainables.numerics.simd import WIDTH
from trainables.numerics.tiles import BIAS, RELU


@compiled
def load_batch(inputs: int, x: F32, n: int, work: Workspace) -> None:
    """Make x (inputs, n), flat, the values X_0."""
    rows = offsets(work, LEFT)
    for k in range(inputs):
        rows[k] = k * n
    for j in range(0, n, WIDTH):
        pack(x, j, rows, inputs, min(WIDTH, n - j), work.values, j * inputs)


@compiled
def forward(sizes: I64, parameters: F32, n: int, work: Workspace) -> int:
    """Compute X_1, ..., X_L from the first n columns of X_0, and return the offset of X_L in `values`.

    The ReLU passes a NaN on.
    """
    layers, columns = len(sizes) - 1, padded(work.batch[0])
    right, row = offsets(work, RIGHT), offsets(work, ROW)
    w0, x0, unit0 = 0, 0, 0
    work.active[: sizes[0]] = offsets(work, IDENTITY)[: sizes[0]]
    work.counts[0] = sizes[0]
    for layer in range(layers):
        n_in, n_out = sizes[layer], sizes[layer + 1]
        count, b0, z0 = work.counts[layer], w0 + n_in * n_out, x0 + n_in * columns
        units, flags = work.active[unit0:], work.active[unit0 + n_in : unit0 + n_in + n_out]
        for k in range(count):
            right[k] = units[k] * WIDTH
        flags[:] = 0
        finish = RELU if layer < layers - 1 else BIAS
        for j in range(0, n, WIDTH):
            product(
                n_out, count, parameters, w0, n_in, units, work.values, x0 + j * n_in, right,
                work.values, z0 + j * n_out, row, finish, parameters, b0, flags,
            )  # fmt: skip
        work.counts[layer + 1] = _indices(flags)
        w0, x0, unit0 = b0 + n_out, z0, unit0 + n_in
    return x0


@compiled
def _indices(flags: I64) -> int:
    """Replace the flags by the indices of those that are set, and return their number: at least 1, a unit of zeros."""
    count = 0
    for i in range(len(flags)):
        if flags[i]:
            flags[count] = i
            count += 1
    if count == 0:
        flags[0] = 0
    return max(count, 1)


@compiled
def single(sizes: I64, parameters: F32, x: F32, out: F32) -> int:
    """Compute the outputs for one input x (inputs,); return their offset in `out`, which has space for all layers."""
    layers, w0, x0, z0 = len(sizes) - 1, 0, 0, 0
    source = x
    for layer in range(layers):
        n_in, n_out = sizes[layer], sizes[layer + 1]
        b0 = w0 + n_in * n_out
        dots(n_out, n_in, parameters, w0, n_in, source, x0, out, z0)
        for i in range(n_out):
            value = out[z0 + i] + parameters[b0 + i]
            out[z0 + i] = np.float32(0.0) if layer < layers - 1 and value <= 0 else value
        w0 = b0 + n_out
        source, x0 = out, z0
        z0 += n_out
    return x0


@compiled
def update(
    sizes: I64,
    parameters: F32,
    first: F32,
    second: F32,
    work: Workspace,
    x: F32,
    actions: I64,
    targets: F32,
    step: int,
    rate: float,
    max_norm: float,
    huber: bool,
) -> float:
    """Take a step towards `targets` (batch,) for the outputs of `actions` (batch,) at x (inputs, batch), flat.

    Return the loss: the mean of (output - target)^2, or the Huber loss with threshold 1.
    """
    batch = len(actions)
    load_batch(sizes[0], x, batch, work)
    total = output_errors(sizes, forward(sizes, parameters, batch, work), actions, targets, huber, work)
    backward(sizes, parameters, batch, work)
    adam(parameters, first, second, work.gradient, step, rate, max_norm)
    return total / batch


@compiled
def output_errors(sizes: I64, z0: int, actions: I64, targets: F32, huber: bool, work: Workspace) -> float:
    """Compute E_L from the outputs at z0: d loss / d output, 0 except for `actions`. Return the loss, as a sum."""
    batch, n_out, rows, e0 = len(actions), sizes[-1], padded(work.batch[0]), errors_at(sizes, work)
    for panel in range(e0, e0 + padded(n_out) * rows, rows * WIDTH):
        work.errors[panel : panel + batch * WIDTH] = 0.0
    total, share = 0.0, np.float32(1.0 / batch)
    for j in range(batch):
        action = actions[j]
        error = work.values[z0 + j // WIDTH * WIDTH * n_out + action * WIDTH + j % WIDTH] - targets[j]
        at = e0 + action // WIDTH * rows * WIDTH + j * WIDTH + action % WIDTH
        if not huber:
            total += error * error
            work.errors[at] = np.float32(2.0) * error * share
        elif abs(error) < 1:
            total += np.float32(0.5) * error * error
            work.errors[at] = error * share
        else:
            total += abs(error) - np.float32(0.5)
            work.errors[at] = share if error > 0 else (-share if error < 0 else error)
    return total


@compiled
def outputs(sizes: I64, parameters: F32, work: Workspace, rows: F32, out: F32) -> None:
    """Compute the outputs (n, actions) for the inputs `rows` (n, inputs)."""
    batch, n_in, n_out = work.batch[0], sizes[0], sizes[-1]
    for start in range(0, len(rows), batch):
        n = min(batch, len(rows) - start)
        for i in range(padded(n)):
            column = i // WIDTH * n_in * WIDTH + i % WIDTH
            for k in range(n_in):
                work.values[column + k * WIDTH] = rows[start + i, k] if i < n else np.float32(0.0)
        z0 = forward(sizes, parameters, n, work)
        for i in range(n):
            column = z0 + i // WIDTH * n_out * WIDTH + i % WIDTH
            for k in range(n_out):
                out[start + i, k] = work.values[column + k * WIDTH]
