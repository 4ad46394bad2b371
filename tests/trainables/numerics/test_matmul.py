"""Matrix products: right in every shape and layout, and equal to a plain chain of fused multiply-adds."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from trainables.numerics.matmul import dots, matmul, norm
from trainables.numerics.simd import MOST_WIDTH

SIZES = st.integers(1, 70)


def product(a: np.ndarray, b: np.ndarray, layout: str) -> np.ndarray:
    """A (m, k) @ B (k, n) with the operands stored as `layout` says: n as they are, t transposed."""
    (m, k), n = a.shape, b.shape[1]
    flat_a = np.ascontiguousarray(a if layout[0] == "n" else a.T).ravel()
    flat_b = np.ascontiguousarray(b if layout[1] == "n" else b.T).ravel()
    strides_a = (k, 1) if layout[0] == "n" else (1, m)
    strides_b = (n, 1) if layout[1] == "n" else (1, k)
    c, scratch = np.full(m * n + 1, np.nan, np.float32), np.full((k + max(m, n)) * MOST_WIDTH, np.nan, np.float32)
    matmul(m, n, k, flat_a, 0, *strides_a, flat_b, 0, *strides_b, c, 0, n, 1, scratch)
    assert np.isnan(c[-1]), "wrote beyond the result"
    return c[:-1].reshape(m, n)


@settings(max_examples=60, deadline=None)
@given(m=SIZES, n=SIZES, k=SIZES, layout=st.sampled_from(["nn", "nt", "tn", "tt"]), seed=st.integers(0, 9))
def test_a_product_equals_numpys(m: int, n: int, k: int, layout: str, seed: int) -> None:
    rng = np.random.default_rng(seed)
    a, b = rng.standard_normal((m, k)).astype(np.float32), rng.standard_normal((k, n)).astype(np.float32)
    expected = a.astype(np.float64) @ b
    np.testing.assert_allclose(product(a, b, layout), expected, rtol=0, atol=1e-6 * k)


def test_each_element_is_one_chain_whatever_the_layout_and_the_other_columns() -> None:
    rng = np.random.default_rng(0)
    a, b = rng.standard_normal((11, 50)).astype(np.float32), rng.standard_normal((50, 67)).astype(np.float32)
    whole = product(a, b, "nn")
    for layout in ("nt", "tn", "tt"):
        np.testing.assert_array_equal(product(a, b, layout), whole)
    for j in (0, 40, 66):
        np.testing.assert_array_equal(product(a, b[:, j : j + 1], "nn")[:, 0], whole[:, j])
    chain = np.zeros((11, 67), np.float32)
    for i in range(50):  # a float64 holds the product exactly, so adding it and rounding once is the fused operation
        chain = (a[:, i : i + 1].astype(np.float64) * b[i].astype(np.float64) + chain).astype(np.float32)
    assert np.abs(whole - chain).max() <= np.spacing(np.abs(chain)).max(), "beyond double rounding"


@pytest.mark.parametrize("length", [1, 15, 16, 17, 64, 250])
@pytest.mark.parametrize("rows", [1, 7, 8, 19])
def test_dot_products_equal_numpys_and_do_not_depend_on_the_other_rows(rows: int, length: int) -> None:
    rng = np.random.default_rng(length)
    a, b = rng.standard_normal(rows * length + 2).astype(np.float32), rng.standard_normal(length + 1).astype(np.float32)
    c, alone = np.full(rows + 1, np.nan, np.float32), np.zeros(1, np.float32)
    dots(rows, length, a, 2, length, b, 1, c, 0)
    expected = a[2:].reshape(rows, length).astype(np.float64) @ b[1:]
    np.testing.assert_allclose(c[:-1], expected, atol=1e-6 * length)
    assert np.isnan(c[-1])
    for row in range(rows):
        dots(1, length, a, 2 + row * length, length, b, 1, alone, 0)
        assert alone[0] == c[row]


@pytest.mark.parametrize("length", [1, 127, 128, 386, 5000])
def test_a_norm_equals_numpys(length: int) -> None:
    a = np.random.default_rng(length).standard_normal(length).astype(np.float32)
    assert norm(a) == pytest.approx(float(np.linalg.norm(a.astype(np.float64))), rel=1e-6)
