"""The compiled arithmetic of a ReLU multilayer perceptron: forward, backward, and Adam on flat parameters.

Parameters lie as torch's `nn.Sequential` of `nn.Linear` orders them: W1 (n1, n0), b1 (n1), W2 (n2, n1), ... .
Layers l = 0 (the input) to L (the output) have values X_l (n_l, batch), and errors E_l = d loss / d pre-activation,
transposed, (batch, n_l). The errors of the last hidden layer are those of the units that were active for a sample of
the batch: the others add nothing but zeros. Reductions run in a fixed order, so results do not depend on the machine
(see `matmul`).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from trainables.agents.adam import adam
from trainables.agents.tiles import BIAS, MASK, RELU, STORE
from trainables.numerics.jit import compiled
from trainables.numerics.matmul import F32, column_sums, dots, pack, padded, product, transpose
from trainables.numerics.simd import MOST_WIDTH, WIDTH

I64 = NDArray[np.int64]


class Workspace(NamedTuple):
    """Room for one pass over a batch. Matrices are in the panels of `matmul`, one layer after the other."""

    values: F32
    """X_0, ..., X_L, columns padded to whole panels."""
    errors: F32
    """E_1, ..., E_L, rows padded to whole panels. On the way down each takes the place of X_l transposed."""
    gradient: F32
    """d loss / d parameters."""
    panel: F32
    """One panel of a right factor; one of a result."""
    active: I64
    """Active units of each layer, ascending, as long as the layer."""
    counts: I64
    """How many they are."""
    lists: I64
    """Lists of offsets, `LISTS` of them, each as long as the longest layer or the batch, padded."""
    batch: I64
    """The largest batch, one number."""


LISTS = 6
IDENTITY, ROW, ERROR, LEFT, RIGHT, PLACE = range(LISTS)
"""k; k WIDTH; where column k of errors lies; and three that each product fills as it needs."""


def parameter_count(sizes: I64) -> int:
    """Weights and biases of a network with these layer sizes, input first."""
    return int(np.sum((sizes[:-1] + 1) * sizes[1:]))


def aligned(count: int) -> F32:
    """Zeros that start at a cache line."""
    raw = np.zeros(count + 16, np.float32)
    first = (-raw.ctypes.data // 4) % 16
    return raw[first : first + count]


def workspace(sizes: I64, batch: int) -> Workspace:
    """Room for batches of up to `batch`."""
    columns, units = _whole(batch), sum(_whole(int(size)) for size in sizes[1:])
    longest = max(columns, *(_whole(int(size)) for size in sizes))
    work = Workspace(
        values=aligned(int(sizes.sum()) * columns),
        errors=aligned(units * columns),
        gradient=aligned(parameter_count(sizes)),
        panel=aligned(2 * longest * MOST_WIDTH),
        active=np.zeros(int(sizes.sum()), np.int64),
        counts=np.zeros(len(sizes), np.int64),
        lists=np.zeros(LISTS * longest, np.int64),
        batch=np.array([batch]),
    )
    _fill_lists(work)
    return work


def _whole(count: int) -> int:
    return -(-count // MOST_WIDTH) * MOST_WIDTH


@compiled
def _list(work: Workspace, which: int) -> I64:
    longest = len(work.lists) // LISTS
    return work.lists[which * longest : (which + 1) * longest]


@compiled
def _fill_lists(work: Workspace) -> None:
    """Those that never change. Compiled, since the kernels of a shared cache may be those of another width."""
    rows = padded(work.batch[0])
    identity, row, error = _list(work, IDENTITY), _list(work, ROW), _list(work, ERROR)
    for k in range(len(identity)):
        identity[k] = k
        row[k] = k * WIDTH
        error[k] = k // WIDTH * rows * WIDTH + k % WIDTH


@compiled
def load_batch(inputs: int, x: F32, n: int, work: Workspace) -> None:
    """Make x (inputs, n), flat, the values X_0."""
    rows = _list(work, LEFT)
    for k in range(inputs):
        rows[k] = k * n
    for j in range(0, n, WIDTH):
        pack(x, j, rows, inputs, min(WIDTH, n - j), work.values, j * inputs)


@compiled
def forward(sizes: I64, parameters: F32, n: int, work: Workspace) -> int:
    """Fill X_1, ..., X_L from the first n columns of X_0: the offset of X_L in `values`.

    A NaN stays a NaN through the ReLU.
    """
    layers, columns = len(sizes) - 1, padded(work.batch[0])
    right, row = _list(work, RIGHT), _list(work, ROW)
    w0, x0, unit0 = 0, 0, 0
    work.active[: sizes[0]] = _list(work, IDENTITY)[: sizes[0]]
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
    """Outputs of one input x (inputs,): their offset in `out`, which has room for every layer's."""
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
def _bias_gradient(n: int, e0: int, units: I64, b0: int, n_out: int, work: Workspace) -> None:
    """Of the bias at b0 from the errors at e0, whose columns are `units`."""
    rows, edge = padded(work.batch[0]), len(work.panel) // 2
    work.gradient[b0 : b0 + n_out] = 0.0
    for j in range(0, len(units), WIDTH):
        column_sums(n, work.errors, e0 + j * rows, work.panel, edge)
        for i in range(min(WIDTH, len(units) - j)):
            work.gradient[b0 + units[j + i]] = work.panel[edge + i]


@compiled
def _first_gradient(n_in: int, n: int, e0: int, units: I64, n_out: int, work: Workspace) -> None:
    """Of the first layer's weights: X_0 @ E_1, a panel at a time, and transposed."""
    rows, edge = padded(work.batch[0]), len(work.panel) // 2
    left, row = _list(work, LEFT), _list(work, ROW)
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
    """Of the weights at w0 from the errors at e0, of `units`, and the transposed values at t0, of `inputs`."""
    rows, edge = padded(work.batch[0]), len(work.panel) // 2
    place, row = _list(work, PLACE), _list(work, ROW)
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
    """Fill the errors at t0, of `inputs`, from those at e0, of `units`, through the weights at w0 and the ReLU."""
    rows, row = padded(work.batch[0]), _list(work, ROW)
    for i in range(len(units)):
        _list(work, PLACE)[i] = units[i] * n_in
    for j in range(0, len(inputs), WIDTH):
        columns = min(WIDTH, len(inputs) - j)
        if len(inputs) == n_in:
            pack(parameters, w0 + j, _list(work, PLACE), len(units), columns, work.panel, 0)
        else:
            for k in range(len(units)):
                w = w0 + units[k] * n_in
                for c in range(columns):
                    work.panel[k * WIDTH + c] = parameters[w + inputs[j + c]]
                work.panel[k * WIDTH + columns : (k + 1) * WIDTH] = 0.0
        product(
            n, len(units), work.errors, e0, WIDTH, _list(work, ERROR), work.panel, 0, row,
            work.errors, t0 + j * rows, row, MASK, work.errors, t0 + j * rows, units,
        )  # fmt: skip


@compiled
def backward(sizes: I64, parameters: F32, n: int, work: Workspace) -> None:
    """Fill `gradient` from E_L, after `forward` of the same n columns."""
    layers, rows = len(sizes) - 1, padded(work.batch[0])
    w0, e0, x0, unit0 = len(parameters), errors_at(sizes, work), int(np.sum(sizes)) * rows, int(np.sum(sizes))
    x0 -= sizes[-1] * rows
    unit0 -= sizes[-1]
    units = _list(work, IDENTITY)[: sizes[-1]]
    for layer in range(layers - 1, -1, -1):
        n_in, n_out = sizes[layer], sizes[layer + 1]
        w0 -= (n_in + 1) * n_out
        x0 -= n_in * rows
        unit0 -= n_in
        _bias_gradient(n, e0, units, w0 + n_in * n_out, n_out, work)
        if layer == 0:
            _first_gradient(n_in, n, e0, units, n_out, work)
            break
        inputs = _list(work, IDENTITY)[:n_in]
        if layer == layers - 1:
            inputs = work.active[unit0 : unit0 + work.counts[layer]]
        t0 = e0 - padded(n_in) * rows
        left = _list(work, LEFT)
        for i in range(padded(len(inputs))):
            left[i] = inputs[min(i, len(inputs) - 1)] * WIDTH
        transpose(work.values, x0, left, n_in * WIDTH, len(inputs), padded(n), rows, work.errors, t0)
        _gradient(w0, n_in, n_out, n, e0, units, t0, inputs, work)
        _errors_below(parameters, w0, n_in, n, e0, units, t0, inputs, work)
        units, e0 = inputs, t0


@compiled
def errors_at(sizes: I64, work: Workspace) -> int:
    """Where E_L lies."""
    at = 0
    for layer in range(1, len(sizes) - 1):
        at += padded(sizes[layer]) * padded(work.batch[0])
    return at


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
    """One step towards `targets` (batch,) of the outputs of `actions` (batch,) at x (inputs, batch), flat.

    The loss, which is returned, is the mean of (output - target)^2, or Huber's with its bend at 1.
    """
    batch, n_out, rows = len(actions), sizes[-1], padded(work.batch[0])
    load_batch(sizes[0], x, batch, work)
    z0, e0 = forward(sizes, parameters, batch, work), errors_at(sizes, work)
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
    backward(sizes, parameters, batch, work)
    adam(parameters, first, second, work.gradient, step, rate, max_norm)
    return total / batch


@compiled
def outputs(sizes: I64, parameters: F32, work: Workspace, rows: F32, out: F32) -> None:
    """Outputs (n, actions) of the inputs `rows` (n, inputs)."""
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
