"""The compiled arithmetic of a ReLU multilayer perceptron: forward, backward, and Adam on flat parameters.

Parameters lie as torch's `nn.Sequential` of `nn.Linear` orders them: W1 (n1, n0), b1 (n1), W2 (n2, n1), ... .
Activations have the batch last, (n, batch), so that every product reads the weights in torch's own order.
Reductions run in a fixed order, so results do not depend on the machine (see `matmul`).
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from trainables.numerics.jit import compiled
from trainables.numerics.matmul import F32, dots, matmul, norm
from trainables.numerics.simd import MOST_WIDTH

I64 = NDArray[np.int64]

BETA1, BETA2, EPSILON = 0.9, 0.999, 1e-8
"""Adam's constants, torch's defaults."""


BLOCK = 1024


class Workspace(NamedTuple):
    """Room for one pass over a batch. All arrays are flat."""

    activations: F32
    """Every layer but the input, (n, batch) each."""
    errors: F32
    """d loss / d pre-activation, laid out as `activations`."""
    gradient: F32
    """d loss / d parameters."""
    scratch: F32
    ones: F32


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
    room = int(sizes[1:].sum()) * batch
    largest = max(int(sizes.max()), batch)
    scratch = aligned(2 * largest * MOST_WIDTH)
    return Workspace(aligned(room), aligned(room), aligned(parameter_count(sizes)), scratch, np.ones(batch, np.float32))


@compiled
def _bias(rows: int, n: int, z: F32, z0: int, stride: int, b: F32, b0: int, relu: bool) -> None:
    for i in range(rows):
        row, bias = z[z0 + i * stride : z0 + i * stride + n], b[b0 + i]
        if relu:
            for j in range(n):
                value = row[j] + bias
                row[j] = value if not value <= 0 else np.float32(0.0)
        else:
            for j in range(n):
                row[j] += bias


@compiled
def forward(sizes: I64, parameters: F32, x: F32, stride: int, n: int, work: Workspace) -> int:
    """Outputs (actions, n) of the first n columns of x (inputs, stride), flat: their offset in `activations`.

    The rows of every activation are `stride` apart too. A NaN stays a NaN through the ReLU.
    """
    layers, w0, x0, z0 = len(sizes) - 1, 0, 0, 0
    source = x
    for layer in range(layers):
        n_in, n_out = sizes[layer], sizes[layer + 1]
        matmul(
            n_out,
            n,
            n_in,
            parameters,
            w0,
            n_in,
            1,
            source,
            x0,
            stride,
            1,
            work.activations,
            z0,
            stride,
            1,
            work.scratch,
        )
        w0 += n_in * n_out
        _bias(n_out, n, work.activations, z0, stride, parameters, w0, layer < layers - 1)
        w0 += n_out
        source, x0 = work.activations, z0
        z0 += n_out * stride
    return x0


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
def backward(sizes: I64, parameters: F32, x: F32, batch: int, work: Workspace) -> None:
    """Fill `gradient` from the errors of the last layer, after `forward` of the same batch with stride = batch."""
    layers = len(sizes) - 1
    w0, z0 = len(parameters), 0
    for layer in range(1, layers + 1):
        z0 += sizes[layer] * batch
    for layer in range(layers - 1, -1, -1):
        n_in, n_out = sizes[layer], sizes[layer + 1]
        z0 -= n_out * batch
        x0 = z0 - n_in * batch if layer else 0
        below = work.activations if layer else x
        w0 -= n_out
        dots(n_out, batch, work.errors, z0, batch, work.ones, 0, work.gradient, w0)
        w0 -= n_in * n_out
        matmul(
            n_out, n_in, batch, work.errors, z0, batch, 1, below, x0, 1, batch, work.gradient, w0, n_in, 1, work.scratch
        )
        if layer:
            matmul(
                n_in,
                batch,
                n_out,
                parameters,
                w0,
                1,
                n_in,
                work.errors,
                z0,
                batch,
                1,
                work.errors,
                x0,
                batch,
                1,
                work.scratch,
            )
            error, active = work.errors[x0 : x0 + n_in * batch], below[x0 : x0 + n_in * batch]
            for i in range(n_in * batch):
                error[i] = error[i] if active[i] > 0 else np.float32(0.0)


@compiled
def adam(parameters: F32, first: F32, second: F32, gradient: F32, step: int, rate: float, max_norm: float) -> None:
    """Adam's step number `step` (from 1) with the gradient scaled down to the norm `max_norm`, as torch does both."""
    scale = np.float32(min(max_norm / (norm(gradient) + 1e-6), 1.0))
    keep1, keep2 = np.float32(1 - BETA1), np.float32(1 - BETA2)
    decay2, epsilon = np.float32(BETA2), np.float32(EPSILON)
    root = np.float32(1 / math.sqrt(1 - BETA2**step))
    size = np.float32(rate / (1 - BETA1**step))
    for start in range(0, len(parameters), BLOCK):  # short loops over few arrays: the compiler turns them into vectors
        stop = min(start + BLOCK, len(parameters))
        g, m, v, p = gradient[start:stop], first[start:stop], second[start:stop], parameters[start:stop]
        for i in range(stop - start):
            g[i] *= scale
        for i in range(stop - start):
            m[i] += keep1 * (g[i] - m[i])
        for i in range(stop - start):
            v[i] = decay2 * v[i] + keep2 * g[i] * g[i]
        for i in range(stop - start):
            p[i] -= size * np.divide(m[i], np.sqrt(v[i]) * root + epsilon)


@compiled
def update(
    sizes: I64,
    parameters: F32,
    first: F32,
    second: F32,
    activations: F32,
    errors: F32,
    gradient: F32,
    scratch: F32,
    ones: F32,
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
    batch = len(actions)
    work = Workspace(activations, errors, gradient, scratch, ones)
    z0 = forward(sizes, parameters, x, batch, batch, work)
    errors[z0 : z0 + sizes[-1] * batch] = 0.0
    total, share = 0.0, np.float32(1.0 / batch)
    for j in range(batch):
        at = z0 + actions[j] * batch + j
        error = activations[at] - targets[j]
        if not huber:
            total += error * error
            errors[at] = np.float32(2.0) * error * share
        elif abs(error) < 1:
            total += np.float32(0.5) * error * error
            errors[at] = error * share
        else:
            total += abs(error) - np.float32(0.5)
            errors[at] = share if error > 0 else (-share if error < 0 else error)
    backward(sizes, parameters, x, batch, work)
    adam(parameters, first, second, gradient, step, rate, max_norm)
    return total / batch


@compiled
def outputs(
    sizes: I64,
    parameters: F32,
    activations: F32,
    errors: F32,
    gradient: F32,
    scratch: F32,
    ones: F32,
    x: F32,
    rows: F32,
    out: F32,
) -> None:
    """Outputs (n, actions) of the inputs `rows` (n, inputs). x: room for inputs * len(ones) floats."""
    batch, n_in, n_out = len(ones), sizes[0], sizes[-1]
    work = Workspace(activations, errors, gradient, scratch, ones)
    for start in range(0, len(rows), batch):
        n = min(batch, len(rows) - start)
        for i in range(n):
            for k in range(n_in):
                x[k * batch + i] = rows[start + i, k]
        z0 = forward(sizes, parameters, x, batch, n, work)
        for i in range(n):
            for k in range(n_out):
                out[start + i, k] = activations[z0 + k * batch + i]
