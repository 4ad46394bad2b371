"""The vector instructions on which `matmul` is based, as LLVM code for numba.

numba vectorises plain loops only where that keeps the order of summation, which it cannot in the inner loop of a matrix
product; here the vectors are explicit, with fused multiply-adds, and the order is fixed. Arrays are flat and float32;
offsets are in elements.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import llvmlite.binding
from llvmlite import ir
from numba import extending
from numba.core import cgutils, types


def intrinsic(code: Callable[..., Any]) -> Any:
    """Return `code` as a function that compiled code can call: numba's `intrinsic` without type annotations."""
    decorator: Any = extending.intrinsic
    return decorator(code)


LANES = 16
"""Length of the partial sums of `dot`; fixed, like its order of summation."""


def _host_tile() -> tuple[int, int, int]:
    """Return (rows, vectors, lanes) of the register tile for this machine; results do not depend on it."""
    features = llvmlite.binding.get_host_cpu_features()
    if features.get("avx512f"):
        return 8, 2, 16
    return 6, 2, 8 if features.get("avx2") else 4


ROWS, VECTORS, WORD = _host_tile()
WIDTH = VECTORS * WORD
"""Columns of a packed panel."""

MAX_WIDTH = 32
"""Columns of the widest panel. Buffers are sized for it, as a shared cache may hold kernels compiled on another CPU."""


def pointer(context: Any, builder: Any, array_type: Any, array: Any, offset: Any) -> Any:
    """Return the address of an element of a flat array."""
    data = context.make_array(array_type)(context, builder, array).data
    return builder.gep(data, [offset])


def vector_fma(builder: Any, vector: Any) -> Any:
    """Return the fused multiply-add of this vector type."""
    signature = ir.FunctionType(vector, [vector] * 3)
    insert: Any = cgutils.get_or_insert_function
    return insert(builder.module, signature, f"llvm.fma.v{vector.count}f32")


def load(builder: Any, pointer: Any, vector: Any) -> Any:
    """Return the vector at any offset of a float array."""
    loaded = builder.load(builder.bitcast(pointer, vector.as_pointer()))
    loaded.align = 4
    return loaded


def store(builder: Any, value: Any, pointer: Any) -> None:
    """Write a vector to any offset of a float array."""
    builder.store(value, builder.bitcast(pointer, value.type.as_pointer())).align = 4


def broadcast(builder: Any, value: Any, vector: Any) -> Any:
    """Return the vector with `value` in all lanes."""
    one = builder.insert_element(ir.Constant(vector, ir.Undefined), value, ir.Constant(ir.IntType(32), 0))
    mask = ir.Constant(ir.VectorType(ir.IntType(32), vector.count), [0] * vector.count)
    return builder.shuffle_vector(one, ir.Constant(vector, ir.Undefined), mask)


def fence(builder: Any) -> None:
    """Keep LLVM from moving loads across, and from unrolling the loop, which would spill sums. It has no cost."""
    builder.asm(ir.FunctionType(ir.VoidType(), []), "", "", [], True)


def zero(vector: Any) -> Any:
    """Return the vector of zeros."""
    return ir.Constant(vector, [0.0] * vector.count)


def loop(builder: Any, count: Any, initial: list[Any], body: Callable[[Any, list[Any]], list[Any]]) -> list[Any]:
    """Build `for i in range(count)` with values carried in registers: body(i, carried) -> carried. count >= 1."""
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


def _pairwise(builder: Any, total: Any) -> Any:
    """Return the sum of a vector, by adding its halves repeatedly."""
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


def _dots(rows: int, squares: bool = False) -> Any:
    """Return the intrinsic dots(a, a0, a_row, b, b0, chunks, c, c0): c (rows,) = A (rows, chunks * LANES) @ b.

    Each row has a chain of sums per lane; the lanes are then added in pairs. squares: use A itself instead of b.
    """

    @intrinsic
    def dots(typing: Any, a: Any, a0: Any, a_row: Any, b: Any, b0: Any, chunks: Any, c: Any, c0: Any) -> Any:
        def codegen(context: Any, builder: Any, signature: Any, args: Any) -> Any:
            a, a0, a_row, b, b0, chunks, c, c0 = args
            vector, number = ir.VectorType(ir.FloatType(), LANES), a_row.type
            fma = vector_fma(builder, vector)
            a_at = pointer(context, builder, signature.args[0], a, a0)
            b_at = pointer(context, builder, signature.args[3], b, b0)
            c_at = pointer(context, builder, signature.args[6], c, c0)

            def body(index: Any, sums: list[Any]) -> list[Any]:
                at = builder.mul(index, ir.Constant(number, LANES))
                y = None if squares else load(builder, builder.gep(b_at, [at]), vector)
                out = []
                for r, total in enumerate(sums):
                    place = builder.add(at, builder.mul(a_row, ir.Constant(number, r)))
                    x = load(builder, builder.gep(a_at, [place]), vector)
                    out.append(builder.call(fma, [x, x if y is None else y, total]))
                return out

            for r, total in enumerate(loop(builder, chunks, [zero(vector)] * rows, body)):
                builder.store(_pairwise(builder, total), builder.gep(c_at, [ir.Constant(number, r)]))
            return context.get_dummy_value()

        size = types.intp
        return types.void(a, size, size, b, size, size, c, size), codegen

    return dots


dots8, dots1, squares8, squares1 = _dots(8), _dots(1), _dots(8, True), _dots(1, True)


@intrinsic
def lane_sums(typing: Any, a: Any, a0: Any, a_row: Any, chunks: Any, c: Any, c0: Any) -> Any:
    """Sum WIDTH columns of chunks * LANES rows into c, in the order of `dots` with a vector of ones: chunks >= 1."""

    def codegen(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        a, a0, a_row, chunks, c, c0 = args
        vector, number = ir.VectorType(ir.FloatType(), WORD), a_row.type
        for v in range(VECTORS):
            lane = ir.Constant(number, v * WORD)
            a_at = pointer(context, builder, signature.args[0], a, builder.add(a0, lane))
            c_at = pointer(context, builder, signature.args[4], c, builder.add(c0, lane))

            def body(index: Any, sums: list[Any], origin: Any = a_at) -> list[Any]:
                first = builder.mul(index, ir.Constant(number, LANES))
                places = [builder.mul(a_row, builder.add(first, ir.Constant(number, r))) for r in range(LANES)]
                rows = [load(builder, builder.gep(origin, [place]), vector) for place in places]
                return [builder.fadd(total, row) for total, row in zip(sums, rows, strict=True)]

            sums = loop(builder, chunks, [zero(vector)] * LANES, body)
            while len(sums) > 1:
                half = len(sums) // 2
                sums = [builder.fadd(sums[r], sums[r + half]) for r in range(half)]
            store(builder, sums[0], c_at)
        return context.get_dummy_value()

    size = types.intp
    return types.void(a, size, size, size, c, size), codegen


@intrinsic
def transpose_block(typing: Any, a: Any, a0: Any, a_at: Any, i: Any, b: Any, b0: Any, b_row: Any) -> Any:
    """Write the transpose of a (WORD, WORD) block, whose rows lie at a0 + a_at[i:], to b0.

    Row i is interleaved with row i + half, log2 times.
    """

    def codegen(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        a, a0, a_at, i, b, b0, b_row = args
        vector = ir.VectorType(ir.FloatType(), WORD)
        origin = pointer(context, builder, signature.args[0], a, a0)
        places = pointer(context, builder, signature.args[2], a_at, i)
        target = pointer(context, builder, signature.args[4], b, b0)
        size, half = b_row.type, WORD // 2
        offsets = [builder.load(builder.gep(places, [ir.Constant(size, r)])) for r in range(WORD)]
        rows = [load(builder, builder.gep(origin, [offset]), vector) for offset in offsets]
        mask_type = ir.VectorType(ir.IntType(32), WORD)
        masks = [ir.Constant(mask_type, [start + i // 2 + (i % 2) * WORD for i in range(WORD)]) for start in (0, half)]
        for _ in range(WORD.bit_length() - 1):
            rows = [builder.shuffle_vector(rows[i], rows[i + half], mask) for i in range(half) for mask in masks]
        for r, row in enumerate(rows):
            store(builder, row, builder.gep(target, [builder.mul(b_row, ir.Constant(size, r))]))
        return context.get_dummy_value()

    size = types.intp
    return types.void(a, size, a_at, size, b, size, size), codegen


@intrinsic
def copy_rows(typing: Any, a: Any, a0: Any, a_at: Any, k: Any, b: Any, b0: Any) -> Any:
    """Copy the WIDTH elements at a0 + a_at[i] to b0 + i WIDTH, for i < k; k >= 1."""

    def codegen(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        a, a0, a_at, k, b, b0 = args
        vector = ir.VectorType(ir.FloatType(), WORD)
        origin = pointer(context, builder, signature.args[0], a, a0)
        places = pointer(context, builder, signature.args[2], a_at, ir.Constant(k.type, 0))
        target = pointer(context, builder, signature.args[4], b, b0)

        def body(index: Any, carried: list[Any]) -> list[Any]:
            row = builder.gep(origin, [builder.load(builder.gep(places, [index]))])
            write = builder.gep(target, [builder.mul(index, ir.Constant(k.type, WIDTH))])
            for v in range(VECTORS):
                lane = ir.Constant(k.type, v * WORD)
                store(builder, load(builder, builder.gep(row, [lane]), vector), builder.gep(write, [lane]))
            return carried

        loop(builder, k, [], body)
        return context.get_dummy_value()

    size = types.intp
    return types.void(a, size, a_at, size, b, size), codegen
