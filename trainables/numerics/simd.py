"""The vector instructions that `matmul` is made of, as LLVM code for numba.

numba turns plain loops into vectors only where that keeps their order of summation, which a matrix product's inner loop
does not; here the vectors are spelled out, with fused multiply-adds, and the order is fixed. Arrays are flat and
float32; a place in one is an offset in elements.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import llvmlite.binding
from llvmlite import ir
from numba import extending
from numba.core import cgutils, types


def _intrinsic(code: Callable[..., Any]) -> Any:
    intrinsic: Any = extending.intrinsic
    return intrinsic(code)


LANES = 16
"""Length of the partial sums of `dot`: fixed, so that its order of summation is."""


def _host_tile() -> tuple[int, int, int]:
    """(rows, vectors, lanes) of the register tile that suits this machine; results do not depend on it."""
    features = llvmlite.binding.get_host_cpu_features()
    if features.get("avx512f"):
        return 8, 2, 16
    return 4, 2, 8 if features.get("avx2") else 4


ROWS, VECTORS, WORD = _host_tile()
WIDTH = VECTORS * WORD
"""Columns of a packed panel."""

MOST_WIDTH = 32
"""Columns of the widest panel of any machine. Room is made for that: kernels in a shared cache may be another one's."""


def _pointer(context: Any, builder: Any, array_type: Any, array: Any, offset: Any) -> Any:
    data = context.make_array(array_type)(context, builder, array).data
    return builder.gep(data, [offset])


def _vector_fma(builder: Any, vector: Any) -> Any:
    signature = ir.FunctionType(vector, [vector] * 3)
    insert: Any = cgutils.get_or_insert_function
    return insert(builder.module, signature, f"llvm.fma.v{vector.count}f32")


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


def _loop(builder: Any, count: Any, initial: list[Any], body: Callable[[Any, list[Any]], list[Any]]) -> list[Any]:
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

    @_intrinsic
    def tile(
        typing: Any, a: Any, a0: Any, a_row: Any, a_k: Any, panel: Any, p0: Any, k: Any, c: Any, c0: Any, c_row: Any
    ) -> Any:
        def codegen(context: Any, builder: Any, signature: Any, args: Any) -> Any:
            a, a0, a_row, a_k, panel, p0, k, c, c0, c_row = args
            vector = ir.VectorType(ir.FloatType(), WORD)
            fma = _vector_fma(builder, vector)
            a_at = _pointer(context, builder, signature.args[0], a, a0)
            p_at = _pointer(context, builder, signature.args[4], panel, p0)
            c_at = _pointer(context, builder, signature.args[7], c, c0)
            number = k.type

            def body(index: Any, sums: list[Any]) -> list[Any]:
                row_of_b = builder.gep(p_at, [builder.mul(index, ir.Constant(number, WIDTH))])
                b = [
                    _load(builder, builder.gep(row_of_b, [ir.Constant(number, v * WORD)]), vector)
                    for v in range(VECTORS)
                ]
                column_of_a = builder.gep(a_at, [builder.mul(index, a_k)])
                out = []
                for r in range(rows):
                    at = builder.gep(column_of_a, [builder.mul(a_row, ir.Constant(number, r))])
                    x = _broadcast(builder, builder.load(at), vector)
                    out += [builder.call(fma, [x, b[v], sums[r * VECTORS + v]]) for v in range(VECTORS)]
                return out

            sums = _loop(builder, k, [_zero(vector)] * (rows * VECTORS), body)
            for r in range(rows):
                row_of_c = builder.gep(c_at, [builder.mul(c_row, ir.Constant(number, r))])
                for v in range(VECTORS):
                    at = builder.gep(row_of_c, [ir.Constant(number, v * WORD)])
                    builder.store(sums[r * VECTORS + v], builder.bitcast(at, vector.as_pointer())).align = 4
            return context.get_dummy_value()

        size = types.intp
        return types.void(a, size, size, size, panel, size, size, c, size, size), codegen

    return tile


tile8, tile4, tile2, tile1 = (_tile(min(rows, ROWS)) for rows in (8, 4, 2, 1))


def _pairwise(builder: Any, total: Any) -> Any:
    """The sum of a vector: its halves added, and again until one number is left."""
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


def _dots(rows: int) -> Any:
    """The intrinsic dots(a, a0, a_row, b, b0, chunks, c, c0): c (rows,) = A (rows, chunks * LANES) @ b.

    Each row has one chain of sums for every lane; the lanes are then added in pairs.
    """

    @_intrinsic
    def dots(typing: Any, a: Any, a0: Any, a_row: Any, b: Any, b0: Any, chunks: Any, c: Any, c0: Any) -> Any:
        def codegen(context: Any, builder: Any, signature: Any, args: Any) -> Any:
            a, a0, a_row, b, b0, chunks, c, c0 = args
            vector, number = ir.VectorType(ir.FloatType(), LANES), a_row.type
            fma = _vector_fma(builder, vector)
            a_at = _pointer(context, builder, signature.args[0], a, a0)
            b_at = _pointer(context, builder, signature.args[3], b, b0)
            c_at = _pointer(context, builder, signature.args[6], c, c0)

            def body(index: Any, sums: list[Any]) -> list[Any]:
                at = builder.mul(index, ir.Constant(number, LANES))
                y = _load(builder, builder.gep(b_at, [at]), vector)
                out = []
                for r, total in enumerate(sums):
                    place = builder.add(at, builder.mul(a_row, ir.Constant(number, r)))
                    out.append(builder.call(fma, [_load(builder, builder.gep(a_at, [place]), vector), y, total]))
                return out

            for r, total in enumerate(_loop(builder, chunks, [_zero(vector)] * rows, body)):
                builder.store(_pairwise(builder, total), builder.gep(c_at, [ir.Constant(number, r)]))
            return context.get_dummy_value()

        size = types.intp
        return types.void(a, size, size, b, size, size, c, size), codegen

    return dots


dots8, dots1 = _dots(8), _dots(1)


@_intrinsic
def transpose_block(typing: Any, a: Any, a0: Any, a_row: Any, b: Any, b0: Any, b_row: Any) -> Any:
    """Write the transpose of the (WORD, WORD) block at a0 to b0: interleave row i with row i + half, log2 times."""

    def codegen(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        a, a0, a_row, b, b0, b_row = args
        vector = ir.VectorType(ir.FloatType(), WORD)
        a_at = _pointer(context, builder, signature.args[0], a, a0)
        b_at = _pointer(context, builder, signature.args[3], b, b0)
        size, half = a_row.type, WORD // 2
        rows = [
            _load(builder, builder.gep(a_at, [builder.mul(a_row, ir.Constant(size, r))]), vector) for r in range(WORD)
        ]
        mask_type = ir.VectorType(ir.IntType(32), WORD)
        masks = [ir.Constant(mask_type, [start + i // 2 + (i % 2) * WORD for i in range(WORD)]) for start in (0, half)]
        for _ in range(WORD.bit_length() - 1):
            rows = [builder.shuffle_vector(rows[i], rows[i + half], mask) for i in range(half) for mask in masks]
        for r, row in enumerate(rows):
            at = builder.gep(b_at, [builder.mul(b_row, ir.Constant(size, r))])
            builder.store(row, builder.bitcast(at, vector.as_pointer())).align = 4
        return context.get_dummy_value()

    size = types.intp
    return types.void(a, size, size, b, size, size), codegen


@_intrinsic
def copy_panel(typing: Any, b: Any, b0: Any, b_k: Any, panel: Any, k: Any) -> Any:
    """Copy the k rows of WIDTH elements at b0, b_k apart, into the panel."""

    def codegen(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        b, b0, b_k, panel, k = args
        vector = ir.VectorType(ir.FloatType(), WORD)
        origin = _pointer(context, builder, signature.args[0], b, b0)
        target = _pointer(context, builder, signature.args[3], panel, ir.Constant(k.type, 0))

        def body(index: Any, carried: list[Any]) -> list[Any]:
            for v in range(VECTORS):
                lane = ir.Constant(k.type, v * WORD)
                read = builder.gep(origin, [builder.add(builder.mul(index, b_k), lane)])
                write = builder.gep(target, [builder.add(builder.mul(index, ir.Constant(k.type, WIDTH)), lane)])
                row = _load(builder, read, vector)
                builder.store(row, builder.bitcast(write, vector.as_pointer())).align = 4
            return carried

        _loop(builder, k, [], body)
        return context.get_dummy_value()

    return types.void(b, types.intp, types.intp, panel, types.intp), codegen
