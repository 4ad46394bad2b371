"""The register tile of the learner's matrix products, as LLVM code for numba.

A tile is a block of C (ROWS, WIDTH) = A @ B that stays in registers while k runs; a bias and ReLU, or the derivative of
the ReLU, are applied there too, before the block is written. Lists of offsets define the rows of A, B and C, so that a
product can skip what is known to be zero.
"""

from __future__ import annotations

from typing import Any

from llvmlite import ir
from numba.core import types

from trainables.numerics.simd import (
    ROWS,
    VECTORS,
    WORD,
    broadcast,
    fence,
    intrinsic,
    load,
    loop,
    pointer,
    store,
    vector_fma,
    zero,
)

STORE, BIAS, RELU, MASK = range(4)
"""The operation on the sums: none; add the row's bias; add it and apply a ReLU; set to 0 where `other` is not > 0."""


def _tile(rows: int) -> Any:
    """Return the intrinsic tile(a, a0, a_row, a_at, b, b0, b_at, k, c, c0, c_at, i, finish, other, other0, alive).

    C[r] = sum over k of A[r, k] B[k], for r < rows: A[r, k] is a[a0 + r a_row + a_at[k]], B[k] the WIDTH elements at
    b[b0 + b_at[k]], and C[r] those at c[c0 + c_at[i + r]]. k >= 1. The bias of a row is other[other0 + i + r]; the mask
    has the layout of C in `other`. RELU sets bits in alive[i + r] where a result of the row is not 0.
    """

    @intrinsic
    def tile(
        typing: Any, a: Any, a0: Any, a_row: Any, a_at: Any, b: Any, b0: Any, b_at: Any, k: Any, c: Any, c0: Any,
        c_at: Any, i: Any, finish: Any, other: Any, other0: Any, alive: Any,
    ) -> Any:  # fmt: skip
        size = types.intp
        signature = types.void(
            a, size, size, a_at, b, size, b_at, size, c, size, c_at, size, size, other, size, alive
        )  # fmt: skip

        def codegen(context: Any, builder: Any, signature: Any, args: Any) -> Any:
            a, a0, a_row, a_at, b, b0, b_at, k, c, c0, c_at, i, finish, other, other0, alive = args
            number = k.type
            vector = ir.VectorType(ir.FloatType(), WORD)
            fma = vector_fma(builder, vector)
            none = ir.Constant(number, 0)

            def at(position: int, array: Any, offset: Any) -> Any:
                return pointer(context, builder, signature.args[position], array, offset)

            a_origin, b_origin = at(0, a, a0), at(4, b, b0)
            a_list, b_list = at(3, a_at, none), at(6, b_at, none)
            row_offsets = [builder.mul(a_row, ir.Constant(number, r)) for r in range(rows)]

            def body(index: Any, sums: list[Any]) -> list[Any]:
                row_of_b = builder.gep(b_origin, [builder.load(builder.gep(b_list, [index]))])
                column_of_a = builder.gep(a_origin, [builder.load(builder.gep(a_list, [index]))])
                right = [
                    load(builder, builder.gep(row_of_b, [ir.Constant(number, v * WORD)]), vector)
                    for v in range(VECTORS)
                ]
                out = []
                for r in range(rows):
                    fence(builder)
                    left = broadcast(builder, builder.load(builder.gep(column_of_a, [row_offsets[r]])), vector)
                    out += [builder.call(fma, [left, right[v], sums[r * VECTORS + v]]) for v in range(VECTORS)]
                return out

            sums = loop(builder, k, [zero(vector)] * (rows * VECTORS), body)
            places = [
                builder.load(builder.gep(at(10, c_at, i), [ir.Constant(number, r)])) for r in range(rows)
            ]  # fmt: skip

            def write(results: list[Any]) -> None:
                for r in range(rows):
                    row = builder.gep(at(8, c, c0), [places[r]])
                    for v in range(VECTORS):
                        store(builder, results[r * VECTORS + v], builder.gep(row, [ir.Constant(number, v * WORD)]))

            def biased() -> list[Any]:
                out = []
                for r in range(rows):
                    bias = builder.load(builder.gep(at(13, other, other0), [builder.add(i, ir.Constant(number, r))]))
                    wide = broadcast(builder, bias, vector)
                    out += [builder.fadd(sums[r * VECTORS + v], wide) for v in range(VECTORS)]
                return out

            def rectified() -> list[Any]:
                out = []
                for value in biased():
                    out.append(builder.select(builder.fcmp_ordered("<=", value, zero(vector)), zero(vector), value))
                bits = ir.VectorType(ir.IntType(32), WORD)
                whole = ir.IntType(32 * WORD)
                for r in range(rows):
                    any_bit = builder.bitcast(out[r * VECTORS], bits)
                    for v in range(1, VECTORS):
                        any_bit = builder.or_(any_bit, builder.bitcast(out[r * VECTORS + v], bits))
                    active = builder.icmp_unsigned("!=", builder.bitcast(any_bit, whole), ir.Constant(whole, 0))
                    flag = builder.gep(at(15, alive, i), [ir.Constant(number, r)])
                    builder.store(builder.or_(builder.load(flag), builder.zext(active, number)), flag)
                return out

            def masked() -> list[Any]:
                out = []
                for r in range(rows):
                    row = builder.gep(at(13, other, other0), [places[r]])
                    for v in range(VECTORS):
                        active = load(builder, builder.gep(row, [ir.Constant(number, v * WORD)]), vector)
                        keep = builder.fcmp_ordered(">", active, zero(vector))
                        out.append(builder.select(keep, sums[r * VECTORS + v], zero(vector)))
                return out

            after = builder.append_basic_block("written")
            for kind, results in ((BIAS, biased), (RELU, rectified), (MASK, masked)):
                yes, no = builder.append_basic_block("finish"), builder.append_basic_block("other")
                builder.cbranch(builder.icmp_signed("==", finish, ir.Constant(number, kind)), yes, no)
                builder.position_at_end(yes)
                write(results())
                builder.branch(after)
                builder.position_at_end(no)
            write(sums)
            builder.branch(after)
            builder.position_at_end(after)
            return context.get_dummy_value()

        return signature, codegen

    return tile


tile, tile4, tile2, tile1 = (_tile(rows) for rows in (ROWS, 4, 2, 1))
"""Tiles of ROWS, 4, 2 and 1 rows."""
