"""Matrix products of 32-bit floats for the compiled learner, with the same bits on every machine.

Each element of a product is one chain of fused multiply-adds in the order of k, whatever the width of the
machine's vectors and the number of its cores, so a result never depends on a BLAS library's choice of kernel.
All matrices lie in flat arrays and are named by an offset and two strides, counted in elements.
"""

from __future__ import annotations

from typing import Any

import llvmlite.binding
import numpy as np
from llvmlite import ir
from numba.core import cgutils, types
from numba.extending import intrinsic
from numpy.typing import NDArray

from trainables.jit import compiled

F32 = NDArray[np.float32]

LANES = 16
"""Length of the partial sums of `dot`: fixed, so that its order of summation is."""


def _host_tile() -> tuple[int, int, int]:
    """(rows, vectors, lanes) of the register tile that suits this machine; results do not depend on it."""
    features = llvmlite.binding.get_host_cpu_features()
    if features.get("avx512f"):
        return 8, 2, 16
    return 4, 2, 8 if features.get("avx2") else 4


ROWS, _VECTORS, _LANES = _host_tile()
WIDTH = _VECTORS * _LANES
"""Columns of a packed panel."""


def _pointer(context: Any, builder: Any, array_type: Any, array: Any, offset: Any) -> Any:
    data = context.make_array(array_type)(context, builder, array).data
    return builder.gep(data, [offset])


def _vector_fma(builder: Any, vector: Any) -> Any:
    signature = ir.FunctionType(vector, [vector] * 3)
    return cgutils.get_or_insert_function(builder.module, signature, f"llvm.fma.v{vector.count}f32")


def _load(builder: Any, pointer: Any, vector: Any) -> Any:
    loaded = builder.load(builder.bitcast(pointer, vector.as_pointer()))
    loaded.align = 4
    return loaded


def _broadcast(builder: Any, value: Any, vector: Any) -> Any:
    one = builder.insert_element(ir.Constant(vector, ir.Undefined), value, ir.Constant(ir.IntType(32), 0))
    mask = ir.Constant(ir.VectorType(ir.IntType(32), vector.count), [0] * vector.count)
    return builder.shuffle_vector(one, ir.Constant(vector, ir.Undefined), mask)


def _zero(vector: Any) -> Any:
    return ir.Constant(vector, [0.0] * vector.count)


def _loop(builder: Any, count: Any, initial: list[Any], body: Any) -> list[Any]:
    """`for i in range(count)` with values carried in registers: body(i, carried) -> carried. count >= 1."""
    before = builder.block
    block = builder.append_basic_block("k")
    after = builder.append_basic_block("done")
    builder.branch(block)
    builder.position_at_end(block)
    index = builder.phi(count.type)
    carried = [builder.phi(value.type) for value in initial]
    results = body(index, carried)
    following = builder.add(index, ir.Constant(count.type, 1))
    builder.cbranch(builder.icmp_signed("<", following, count), block, after)
    index.add_incoming(ir.Constant(count.type, 0), before)
    index.add_incoming(following, builder.block)
    for phi, first, result in zip(carried, initial, results, strict=True):
        phi.add_incoming(first, before)
        phi.add_incoming(result, block)
    builder.position_at_end(after)
    return results


def _tile(rows: int) -> Any:
    """The intrinsic tile(a, a0, a_row, a_k, panel, p0, k, c, c0, c_row): C (rows, WIDTH) = A (rows, k) @ panel."""

    @intrinsic  # type: ignore[untyped-decorator]
    def tile(
        typing: Any, a: Any, a0: Any, a_row: Any, a_k: Any, panel: Any, p0: Any, k: Any, c: Any, c0: Any, c_row: Any
    ) -> Any:
        def codegen(context: Any, builder: Any, signature: Any, args: Any) -> Any:
            a, a0, a_row, a_k, panel, p0, k, c, c0, c_row = args
            vector = ir.VectorType(ir.FloatType(), _LANES)
            fma = _vector_fma(builder, vector)
            a_at = _pointer(context, builder, signature.args[0], a, a0)
            p_at = _pointer(context, builder, signature.args[4], panel, p0)
            c_at = _pointer(context, builder, signature.args[7], c, c0)
            number = k.type

            def body(index: Any, sums: list[Any]) -> list[Any]:
                row_of_b = builder.gep(p_at, [builder.mul(index, ir.Constant(number, WIDTH))])
                b = [
                    _load(builder, builder.gep(row_of_b, [ir.Constant(number, v * _LANES)]), vector)
                    for v in range(_VECTORS)
                ]
                column_of_a = builder.gep(a_at, [builder.mul(index, a_k)])
                out = []
                for r in range(rows):
                    at = builder.gep(column_of_a, [builder.mul(a_row, ir.Constant(number, r))])
                    x = _broadcast(builder, builder.load(at), vector)
                    out += [builder.call(fma, [x, b[v], sums[r * _VECTORS + v]]) for v in range(_VECTORS)]
                return out

            sums = _loop(builder, k, [_zero(vector)] * (rows * _VECTORS), body)
            for r in range(rows):
                row_of_c = builder.gep(c_at, [builder.mul(c_row, ir.Constant(number, r))])
                for v in range(_VECTORS):
                    at = builder.gep(row_of_c, [ir.Constant(number, v * _LANES)])
                    builder.store(sums[r * _VECTORS + v], builder.bitcast(at, vector.as_pointer())).align = 4
            return context.get_dummy_value()

        size = types.intp
        return types.void(a, size, size, size, panel, size, size, c, size, size), codegen

    return tile


_tile8, _tile4, _tile2, _tile1 = (_tile(min(rows, ROWS)) for rows in (8, 4, 2, 1))


@intrinsic  # type: ignore[untyped-decorator]
def _dot_lanes(typing: Any, a: Any, a0: Any, b: Any, b0: Any, chunks: Any) -> Any:
    """sum_i a[a0 + i] b[b0 + i] over chunks * LANES elements: one chain for each lane, then the lanes in pairs."""

    def codegen(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        a, a0, b, b0, chunks = args
        vector = ir.VectorType(ir.FloatType(), LANES)
        fma = _vector_fma(builder, vector)
        a_at = _pointer(context, builder, signature.args[0], a, a0)
        b_at = _pointer(context, builder, signature.args[2], b, b0)

        def body(index: Any, sums: list[Any]) -> list[Any]:
            at = builder.mul(index, ir.Constant(chunks.type, LANES))
            x, y = (_load(builder, builder.gep(p, [at]), vector) for p in (a_at, b_at))
            return [builder.call(fma, [x, y, sums[0]])]

        (total,) = _loop(builder, chunks, [_zero(vector)], body)
        half = LANES // 2
        while half:
            upper = ir.Constant(ir.VectorType(ir.IntType(32), half), list(range(half, 2 * half)))
            lower = ir.Constant(ir.VectorType(ir.IntType(32), half), list(range(half)))
            undefined = ir.Constant(total.type, ir.Undefined)
            total = builder.fadd(
                builder.shuffle_vector(total, undefined, lower), builder.shuffle_vector(total, undefined, upper)
            )
            half //= 2
        return builder.extract_element(total, ir.Constant(ir.IntType(32), 0))

    return types.float32(a, types.intp, b, types.intp, types.intp), codegen


@compiled
def dot(a: F32, a0: int, b: F32, b0: int, length: int) -> float:
    """sum_i a[a0 + i] b[b0 + i]."""
    chunks = length // LANES
    total = _dot_lanes(a, a0, b, b0, chunks) if chunks else np.float32(0.0)
    for i in range(chunks * LANES, length):
        total += a[a0 + i] * b[b0 + i]
    return total


@intrinsic  # type: ignore[untyped-decorator]
def _transpose_lanes(typing: Any, a: Any, a0: Any, a_row: Any, b: Any, b0: Any, b_row: Any) -> Any:
    """Write the transpose of the (_LANES, _LANES) block at a0 to b0: interleave row i with row i + half, log2 times."""

    def codegen(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        a, a0, a_row, b, b0, b_row = args
        vector = ir.VectorType(ir.FloatType(), _LANES)
        a_at = _pointer(context, builder, signature.args[0], a, a0)
        b_at = _pointer(context, builder, signature.args[3], b, b0)
        size, half = a_row.type, _LANES // 2
        rows = [
            _load(builder, builder.gep(a_at, [builder.mul(a_row, ir.Constant(size, r))]), vector) for r in range(_LANES)
        ]
        mask_type = ir.VectorType(ir.IntType(32), _LANES)
        masks = [
            ir.Constant(mask_type, [start + i // 2 + (i % 2) * _LANES for i in range(_LANES)]) for start in (0, half)
        ]
        for _ in range(_LANES.bit_length() - 1):
            rows = [builder.shuffle_vector(rows[i], rows[i + half], mask) for i in range(half) for mask in masks]
        for r, row in enumerate(rows):
            at = builder.gep(b_at, [builder.mul(b_row, ir.Constant(size, r))])
            builder.store(row, builder.bitcast(at, vector.as_pointer())).align = 4
        return context.get_dummy_value()

    size = types.intp
    return types.void(a, size, size, b, size, size), codegen


@intrinsic  # type: ignore[untyped-decorator]
def _copy_panel(typing: Any, b: Any, b0: Any, b_k: Any, panel: Any, k: Any) -> Any:
    """Copy the k rows of WIDTH elements at b0, b_k apart, into the panel."""

    def codegen(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        b, b0, b_k, panel, k = args
        vector = ir.VectorType(ir.FloatType(), _LANES)
        origin = _pointer(context, builder, signature.args[0], b, b0)
        target = _pointer(context, builder, signature.args[3], panel, ir.Constant(k.type, 0))

        def body(index: Any, carried: list[Any]) -> list[Any]:
            for v in range(_VECTORS):
                lane = ir.Constant(k.type, v * _LANES)
                read = builder.gep(origin, [builder.add(builder.mul(index, b_k), lane)])
                write = builder.gep(target, [builder.add(builder.mul(index, ir.Constant(k.type, WIDTH)), lane)])
                row = _load(builder, read, vector)
                builder.store(row, builder.bitcast(write, vector.as_pointer())).align = 4
            return carried

        _loop(builder, k, [], body)
        return context.get_dummy_value()

    return types.void(b, types.intp, types.intp, panel, types.intp), codegen


@compiled
def _pack(b: F32, b0: int, b_k: int, b_col: int, k: int, columns: int, panel: F32) -> None:
    """Copy B (k, columns) into the panel (k, WIDTH), zeros to its right."""
    blocks = 0
    if columns < WIDTH:
        panel[: k * WIDTH] = 0.0
    elif b_col == 1:
        _copy_panel(b, b0, b_k, panel, k)
        return
    elif b_k == 1:
        blocks = k // _LANES
        for block in range(blocks):
            for j in range(0, WIDTH, _LANES):
                at = block * _LANES
                _transpose_lanes(b, b0 + at + j * b_col, b_col, panel, at * WIDTH + j, WIDTH)
    for i in range(blocks * _LANES, k):
        for j in range(columns):
            panel[i * WIDTH + j] = b[b0 + i * b_k + j * b_col]


@compiled
def _column(m: int, k: int, a: F32, a0: int, a_row: int, a_k: int, panel: F32, c: F32, c0: int, c_row: int) -> None:
    """C (m, WIDTH) = A (m, k) @ panel (k, WIDTH)."""
    i = 0
    while m - i >= 8 and ROWS >= 8:
        _tile8(a, a0 + i * a_row, a_row, a_k, panel, 0, k, c, c0 + i * c_row, c_row)
        i += 8
    while m - i >= 4:
        _tile4(a, a0 + i * a_row, a_row, a_k, panel, 0, k, c, c0 + i * c_row, c_row)
        i += 4
    if m - i >= 2:
        _tile2(a, a0 + i * a_row, a_row, a_k, panel, 0, k, c, c0 + i * c_row, c_row)
        i += 2
    if m - i == 1:
        _tile1(a, a0 + i * a_row, a_row, a_k, panel, 0, k, c, c0 + i * c_row, c_row)


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
    scratch: F32,
) -> None:
    """C (m, n) = A (m, k) @ B (k, n). scratch: at least (k + m) * WIDTH floats."""
    edge = k * WIDTH
    for j in range(0, n, WIDTH):
        columns = min(WIDTH, n - j)
        _pack(b, b0 + j * b_col, b_k, b_col, k, columns, scratch)
        if columns == WIDTH:
            _column(m, k, a, a0, a_row, a_k, scratch, c, c0 + j, c_row)
        else:
            _column(m, k, a, a0, a_row, a_k, scratch, scratch, edge, WIDTH)
            for i in range(m):
                for at in range(columns):
                    c[c0 + i * c_row + j + at] = scratch[edge + i * WIDTH + at]
