"""The register tile of the learner's matrix products, as LLVM code for numba.

A tile is a block of C (ROWS, WIDTH) = A @ B that stays in registers while k runs; a bias and ReLU, or the derivative of
the ReLU, are applied there too, before the block is written. Lists of offsets define the rows of A, B and C, so that a
product can skip what is known to be zero.
"""

from __future__ import annotations

from collections.abc import Callable
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


class _TileCode:
    """Emits the instructions of one tile of `rows` rows; its arguments are those of `_tile`."""

    def __init__(self, rows: int, context: Any, builder: Any, kinds: dict[str, Any], values: dict[str, Any]) -> None:
        self.rows, self.context, self.builder, self.kinds, self.values = rows, context, builder, kinds, values
        self.vector = ir.VectorType(ir.FloatType(), WORD)
        self.fma = vector_fma(builder, self.vector)
        self.number = values["k"].type

    def emit(self) -> None:
        """Emit the sums, then for each kind of `finish` what is applied to them, and the writing of the block."""
        sums = self.sums()
        places = [self.builder.load(self.gep(self.at("c_at", "i"), r)) for r in range(self.rows)]
        finishes: tuple[tuple[int, Callable[[], list[Any]]], ...] = (
            (BIAS, lambda: self.biased(sums)),
            (RELU, lambda: self.rectified(sums)),
            (MASK, lambda: self.masked(sums, places)),
        )
        after = self.builder.append_basic_block("written")
        for kind, results in finishes:
            yes, no = self.builder.append_basic_block("finish"), self.builder.append_basic_block("other")
            self.builder.cbranch(self.builder.icmp_signed("==", self.values["finish"], self.constant(kind)), yes, no)
            self.builder.position_at_end(yes)
            self.write(results(), places)
            self.builder.branch(after)
            self.builder.position_at_end(no)
        self.write(sums, places)
        self.builder.branch(after)
        self.builder.position_at_end(after)

    def constant(self, value: int) -> Any:
        return ir.Constant(self.number, value)

    def at(self, array: str, offset: str) -> Any:
        """Return the address of the element of an array at the value of another argument."""
        return pointer(self.context, self.builder, self.kinds[array], self.values[array], self.values[offset])

    def gep(self, address: Any, elements: int) -> Any:
        """Return the address so many elements further."""
        return self.builder.gep(address, [self.constant(elements)])

    def sums(self) -> list[Any]:
        """Return the vectors of A @ B, row by row."""
        builder = self.builder
        a_origin, b_origin = self.at("a", "a0"), self.at("b", "b0")
        none = self.constant(0)
        a_list, b_list = (
            pointer(self.context, builder, self.kinds[name], self.values[name], none) for name in ("a_at", "b_at")
        )
        row_offsets = [builder.mul(self.values["a_row"], self.constant(r)) for r in range(self.rows)]

        def body(index: Any, sums: list[Any]) -> list[Any]:
            row_of_b = builder.gep(b_origin, [builder.load(builder.gep(b_list, [index]))])
            column_of_a = builder.gep(a_origin, [builder.load(builder.gep(a_list, [index]))])
            right = [load(builder, self.gep(row_of_b, v * WORD), self.vector) for v in range(VECTORS)]
            out = []
            for r in range(self.rows):
                fence(builder)
                left = broadcast(builder, builder.load(builder.gep(column_of_a, [row_offsets[r]])), self.vector)
                out += [builder.call(self.fma, [left, right[v], sums[r * VECTORS + v]]) for v in range(VECTORS)]
            return out

        return loop(builder, self.values["k"], [zero(self.vector)] * (self.rows * VECTORS), body)

    def write(self, results: list[Any], places: list[Any]) -> None:
        """Write the block to C."""
        for r in range(self.rows):
            row = self.builder.gep(self.at("c", "c0"), [places[r]])
            for v in range(VECTORS):
                store(self.builder, results[r * VECTORS + v], self.gep(row, v * WORD))

    def biased(self, sums: list[Any]) -> list[Any]:
        """Return the sums with their row's bias."""
        out = []
        for r in range(self.rows):
            index = self.builder.add(self.values["i"], self.constant(r))
            bias = self.builder.load(self.builder.gep(self.at("other", "other0"), [index]))
            wide = broadcast(self.builder, bias, self.vector)
            out += [self.builder.fadd(sums[r * VECTORS + v], wide) for v in range(VECTORS)]
        return out

    def rectified(self, sums: list[Any]) -> list[Any]:
        """Return the ReLU of the sums with their bias, and set `alive` of the rows with a result that is not 0."""
        builder, nothing = self.builder, zero(self.vector)
        out = [
            builder.select(builder.fcmp_ordered("<=", value, nothing), nothing, value) for value in self.biased(sums)
        ]
        bits = ir.VectorType(ir.IntType(32), WORD)
        whole = ir.IntType(32 * WORD)
        for r in range(self.rows):
            any_bit = builder.bitcast(out[r * VECTORS], bits)
            for v in range(1, VECTORS):
                any_bit = builder.or_(any_bit, builder.bitcast(out[r * VECTORS + v], bits))
            active = builder.icmp_unsigned("!=", builder.bitcast(any_bit, whole), ir.Constant(whole, 0))
            flag = self.gep(self.at("alive", "i"), r)
            builder.store(builder.or_(builder.load(flag), builder.zext(active, self.number)), flag)
        return out

    def masked(self, sums: list[Any], places: list[Any]) -> list[Any]:
        """Return the sums, 0 where `other` is not > 0."""
        out = []
        for r in range(self.rows):
            row = self.builder.gep(self.at("other", "other0"), [places[r]])
            for v in range(VECTORS):
                active = load(self.builder, self.gep(row, v * WORD), self.vector)
                keep = self.builder.fcmp_ordered(">", active, zero(self.vector))
                out.append(self.builder.select(keep, sums[r * VECTORS + v], zero(self.vector)))
        return out


ARGUMENTS = (
    "a", "a0", "a_row", "a_at", "b", "b0", "b_at", "k", "c", "c0", "c_at", "i", "finish", "other", "other0", "alive"
)  # fmt: skip


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
            named = (dict(zip(ARGUMENTS, each, strict=True)) for each in (signature.args, args))
            _TileCode(rows, context, builder, *named).emit()
            return context.get_dummy_value()

        return signature, codegen

    return tile


tile, tile4, tile2, tile1 = (_tile(rows) for rows in (ROWS, 4, 2, 1))
"""Tiles of ROWS, 4, 2 and 1 rows."""
