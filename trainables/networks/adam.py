"""Adam on flat parameters with clipping of the gradient's norm, in one pass over all four arrays."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from llvmlite import ir
from numba.core import cgutils, types

from trainables.numerics.jit import compiled
from trainables.numerics.matmul import F32, norm
from trainables.numerics.simd import LANES, broadcast, intrinsic, load, loop, pointer, store, zero

BETA1, BETA2, EPSILON = 0.9, 0.999, 1e-8
"""The defaults of torch."""

SMALLEST = float(np.finfo(np.float32).tiny)
"""Moments nearer to 0 become 0, since those of dead units decay to subnormal numbers, which are many times slower."""

BLOCK = 64 * LANES


@intrinsic
def _vectors(
    typing: Any, p: Any, m: Any, v: Any, g: Any, start: Any, chunks: Any, scale: Any, keep1: Any, decay2: Any,
    keep2: Any, root: Any, size: Any, epsilon: Any,
) -> Any:  # fmt: skip
    """Do the step of `_one` for chunks * LANES elements from `start`; chunks >= 1."""

    def codegen(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        vector = ir.VectorType(ir.FloatType(), LANES)
        origins = [pointer(context, builder, signature.args[i], args[i], args[4]) for i in range(4)]
        scale, keep1, decay2, keep2, root, size, epsilon = (broadcast(builder, x, vector) for x in args[6:])
        insert: Any = cgutils.get_or_insert_function
        of_vector = ir.FunctionType(vector, [vector])
        square_root = insert(builder.module, of_vector, f"llvm.sqrt.v{LANES}f32")
        size_of = insert(builder.module, of_vector, f"llvm.fabs.v{LANES}f32")
        smallest, nothing = ir.Constant(vector, [SMALLEST] * LANES), zero(vector)

        def kept(value: Any) -> Any:
            tiny = builder.fcmp_ordered("<", builder.call(size_of, [value]), smallest)
            return builder.select(tiny, nothing, value)

        def body(index: Any, carried: list[Any]) -> list[Any]:
            at = builder.mul(index, ir.Constant(index.type, LANES))
            p_at, m_at, v_at, g_at = (builder.gep(origin, [at]) for origin in origins)
            p, m, v, g = (load(builder, place, vector) for place in (p_at, m_at, v_at, g_at))
            g = builder.fmul(g, scale)
            m = kept(builder.fadd(m, builder.fmul(keep1, builder.fsub(g, m))))
            v = kept(builder.fadd(builder.fmul(decay2, v), builder.fmul(builder.fmul(keep2, g), g)))
            under = builder.fadd(builder.fmul(builder.call(square_root, [v]), root), epsilon)
            p = builder.fsub(p, builder.fmul(size, builder.fdiv(m, under)))
            for place, value in ((m_at, m), (v_at, v), (p_at, p)):
                store(builder, value, place)
            return carried

        loop(builder, args[5], [], body)
        return context.get_dummy_value()

    number, real = types.intp, types.float32
    return types.void(p, m, v, g, number, number, *[real] * 7), codegen


@compiled
def _one(
    p: F32, m: F32, v: F32, i: int, g: np.float32, keep1: np.float32, decay2: np.float32, keep2: np.float32,
    root: np.float32, size: np.float32, epsilon: np.float32,
) -> None:  # fmt: skip
    """Update one parameter by Adam; all numbers have 32 bits."""
    m[i] += keep1 * (g - m[i])
    v[i] = decay2 * v[i] + keep2 * g * g
    if abs(m[i]) < SMALLEST:
        m[i] = 0.0
    if v[i] < SMALLEST:
        v[i] = 0.0
    p[i] -= size * np.divide(m[i], np.sqrt(v[i]) * root + epsilon)


@compiled
def adam(parameters: F32, first: F32, second: F32, gradient: F32, step: int, rate: float, max_norm: float) -> None:
    """Take step number `step` (from 1) of Adam, with the gradient's norm clipped to `max_norm`, both as in torch."""
    scale = np.float32(min(max_norm / (norm(gradient) + 1e-6), 1.0))
    keep1, keep2 = np.float32(1 - BETA1), np.float32(1 - BETA2)
    decay2, epsilon = np.float32(BETA2), np.float32(EPSILON)
    root = np.float32(1 / math.sqrt(1 - BETA2**step))
    size = np.float32(rate / (1 - BETA1**step))
    whole = len(parameters) // LANES * LANES
    for i in range(whole, len(parameters)):
        _one(parameters, first, second, i, gradient[i] * scale, keep1, decay2, keep2, root, size, epsilon)
    for back in range(0, whole, BLOCK):  # from the end, so that the next forward pass finds its beginning in the cache
        start = max(whole - back - BLOCK, 0)
        chunks = (whole - back - start) // LANES
        _vectors(
            parameters, first, second, gradient, start, chunks, scale, keep1, decay2, keep2, root, size, epsilon
        )  # fmt: skip
