"""A training step of a network with a second loss: the distance from a teacher's policy."""

from __future__ import annotations

import math

import numpy as np

from trainables.networks.adam import adam
from trainables.networks.backward import backward
from trainables.networks.mlp import forward, load_batch, output_errors
from trainables.networks.workspace import Workspace, errors_at
from trainables.numerics.jit import compiled
from trainables.numerics.matmul import F32, I64, padded
from trainables.numerics.simd import WIDTH


@compiled
def _add_distance(
    sizes: I64, z0: int, batch: int, teacher: F32, weight: float, temperature: float, work: Workspace
) -> float:
    """Add the gradient of the weighted divergence to E_L; return the divergence, summed over the batch."""
    n_out, rows, e0 = sizes[-1], padded(work.batch[0]), errors_at(sizes, work)
    ours, theirs = np.empty(n_out), np.empty(n_out)
    total, scale = 0.0, weight / (temperature * batch)
    for j in range(batch):
        column = z0 + j // WIDTH * WIDTH * n_out + j % WIDTH
        for a in range(n_out):
            ours[a] = work.values[column + a * WIDTH] / temperature
            theirs[a] = teacher[j, a] / temperature
        ours -= ours.max()
        theirs -= theirs.max()
        our_sum, their_sum = 0.0, 0.0
        for a in range(n_out):
            our_sum += math.exp(ours[a])
            their_sum += math.exp(theirs[a])
        for a in range(n_out):
            our_log, their_log = ours[a] - math.log(our_sum), theirs[a] - math.log(their_sum)
            taught = math.exp(their_log)
            total += taught * (their_log - our_log)
            at = e0 + a // WIDTH * rows * WIDTH + j * WIDTH + a % WIDTH
            work.errors[at] += np.float32(scale * (math.exp(our_log) - taught))
    return total


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
    teacher: F32,
    weight: float,
    temperature: float,
    step: int,
    rate: float,
    max_norm: float,
    huber: bool,
) -> float:
    """Do the same as `mlp.update` with `weight` times the mean KL(teacher's softmax, outputs' softmax) in the loss.

    teacher (batch, actions): the values of the teacher; both softmaxes are at `temperature`.
    """
    batch = len(actions)
    load_batch(sizes[0], x, batch, work)
    z0 = forward(sizes, parameters, batch, work)
    total = output_errors(sizes, z0, actions, targets, huber, work)
    total += weight * _add_distance(sizes, z0, batch, teacher, weight, temperature, work)
    backward(sizes, parameters, batch, work)
    adam(parameters, first, second, work.gradient, step, rate, max_norm)
    return total / batch
