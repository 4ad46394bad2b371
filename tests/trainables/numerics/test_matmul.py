"""Matrix products: right in every shape and layout, and equal to a plain chain of fused multiply-adds."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from trainables.numerics.matmul import column_sums, dots, norm, pack, padded, product, transpose
from trainables.numerics.simd import WIDTH
from trainables.numerics.tiles import BIAS, MASK, RELU, STORE

SIZES = st.integers(1, 70)


def steps(count: int, by: int) -> np.ndarray:
    return np.arange(count, dtype=np.int64) * by


def panels(matrix: np.ndarray) -> np.ndarray:
    """The matrix as `pack` lays it out, flat."""
    k, n = matrix.shape
    flat, out = np.ascontiguousarray(matrix).ravel(), np.full(k * padded(n), np.nan, np.float32)
    for j in range(0, n, WIDTH):
        pack(flat, j, steps(k, n), k, min(WIDTH, n - j), out, j * k)
    return out


def matrix(flat: np.ndarray, rows: int, columns: int) -> np.ndarray:
    """What lies in panels, as a matrix."""
    return flat.reshape(-1, rows, WIDTH).transpose(1, 0, 2).reshape(rows, -1)[:, :columns]


def multiply(
    a: np.ndarray, b: np.ndarray, transposed: bool = False, finish: int = STORE, other: np.ndarray | None = None
) -> tuple[np.ndarray, np.ndarray]:
    """A (m, k) @ B (k, n), A stored transposed or not, and which rows had a result that was not 0."""
    (m, k), n = a.shape, b.shape[1]
    flat = np.ascontiguousarray(a.T if transposed else a).ravel()
    row, by = (1, m) if transposed else (k, 1)
    right, c = panels(b), np.full(m * padded(n) + 1, np.nan, np.float32)
    alive, other = np.zeros(m, np.int64), c if other is None else other
    for j in range(0, n, WIDTH):
        beside = j * m if finish == MASK else 0
        product(
            m, k, flat, 0, row, steps(k, by), right, j * k, steps(k, WIDTH), c, j * m, steps(m, WIDTH),
            finish, other, beside, alive,
        )  # fmt: skip
    assert np.isnan(c[-1]), "wrote beyond the result"
    return matrix(c[:-1], m, n), alive


def random(rng: np.random.Generator, *shape: int) -> np.ndarray:
    return rng.standard_normal(shape).astype(np.float32)


@settings(max_examples=60, deadline=None)
@given(m=SIZES, n=SIZES, k=SIZES, transposed=st.booleans(), seed=st.integers(0, 9))
def test_a_product_equals_numpys(m: int, n: int, k: int, transposed: bool, seed: int) -> None:
    rng = np.random.default_rng(seed)
    a, b = random(rng, m, k), random(rng, k, n)
    expected = a.astype(np.float64) @ b
    np.testing.assert_allclose(multiply(a, b, transposed)[0], expected, rtol=0, atol=1e-6 * k)


def test_each_element_is_one_chain_whatever_the_layout_and_the_other_columns() -> None:
    rng = np.random.default_rng(0)
    a, b = random(rng, 11, 50), random(rng, 50, 67)
    whole, _ = multiply(a, b)
    np.testing.assert_array_equal(multiply(a, b, transposed=True)[0], whole)
    for j in (0, 40, 66):
        np.testing.assert_array_equal(multiply(a, b[:, j : j + 1])[0][:, 0], whole[:, j])
    chain = np.zeros((11, 67), np.float32)
    for i in range(50):  # a float64 holds the product exactly, so adding it and rounding once is the fused operation
        chain = (a[:, i : i + 1].astype(np.float64) * b[i].astype(np.float64) + chain).astype(np.float32)
    assert np.abs(whole - chain).max() <= np.spacing(np.abs(chain)).max(), "beyond double rounding"


@pytest.mark.parametrize("m", [1, 2, 3, 5, 7, 13, 31])
def test_what_follows_a_product_has_the_bits_of_a_pass_of_its_own(m: int) -> None:
    rng = np.random.default_rng(m)
    a, b, bias = random(rng, m, 9), random(rng, 9, 40), random(rng, m)
    bias[0] = -100  # a row that the ReLU makes all 0
    plain, _ = multiply(a, b)
    np.testing.assert_array_equal(multiply(a, b, finish=BIAS, other=bias)[0], plain + bias[:, None])
    rectified, alive = multiply(a, b, finish=RELU, other=bias)
    np.testing.assert_array_equal(rectified, np.maximum(plain + bias[:, None], 0))
    if m > 1:
        assert not alive[0]
    np.testing.assert_array_equal(alive != 0, rectified.any(axis=1) | (multiply_padding(bias) > 0))
    active = random(rng, m, 40)
    masked, _ = multiply(a, b, finish=MASK, other=panels(active))
    np.testing.assert_array_equal(masked, np.where(active > 0, plain, 0))


def multiply_padding(bias: np.ndarray) -> np.ndarray:
    """What the columns that only fill the last panel hold before the ReLU: they count as a row's results too."""
    return bias if padded(40) > 40 else np.full_like(bias, -1)


def test_a_product_can_leave_out_columns_of_a_that_meet_only_zeros() -> None:
    rng = np.random.default_rng(0)
    a, b = random(rng, 13, 50), random(rng, 50, WIDTH)
    kept = np.array([1, 4, 5, 30, 49])
    b[np.setdiff1d(np.arange(50), kept)] = 0
    c = np.zeros(13 * WIDTH, np.float32)
    product(
        13, 5, a.ravel(), 0, 50, kept, b.ravel(), 0, kept * WIDTH, c, 0, steps(13, WIDTH), STORE, c, 0, kept
    )  # fmt: skip
    np.testing.assert_array_equal(c.reshape(13, WIDTH), multiply(a, b)[0])


@pytest.mark.parametrize(("units", "batch"), [(3, 5), (16, 64), (33, 50), (70, 128)])
def test_rows_become_columns(units: int, batch: int) -> None:
    values, whole = random(np.random.default_rng(0), units, batch), padded(batch)
    chosen = np.arange(0, units, 2)
    places = np.zeros(padded(len(chosen)), np.int64)
    places[: len(chosen)] = chosen * WIDTH
    out = np.full(whole * padded(len(chosen)) + 1, np.nan, np.float32)
    transpose(panels(values), 0, places, units * WIDTH, len(chosen), whole, whole, out, 0)
    turned = matrix(out[:-1], whole, padded(len(chosen)))
    np.testing.assert_array_equal(turned[:batch, : len(chosen)], values[chosen].T)
    assert np.isnan(out[-1]), "wrote beyond the result"


@pytest.mark.parametrize("rows", [1, 15, 16, 17, 64, 250])
def test_sums_of_columns_are_those_of_dots_with_ones(rows: int) -> None:
    values = random(np.random.default_rng(rows), rows, WIDTH)
    sums, expected = np.full(WIDTH + 1, np.nan, np.float32), np.zeros(WIDTH, np.float32)
    column_sums(rows, values.ravel(), 0, sums, 0)
    dots(WIDTH, rows, np.ascontiguousarray(values.T).ravel(), 0, rows, np.ones(rows, np.float32), 0, expected, 0)
    np.testing.assert_array_equal(sums[:-1], expected)
    assert np.isnan(sums[-1])


@pytest.mark.parametrize("length", [1, 15, 16, 17, 64, 250])
@pytest.mark.parametrize("rows", [1, 7, 8, 19])
def test_dot_products_equal_numpys_and_do_not_depend_on_the_other_rows(rows: int, length: int) -> None:
    rng = np.random.default_rng(length)
    a, b = random(rng, rows * length + 2), random(rng, length + 1)
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
    a = random(np.random.default_rng(length), length)
    assert norm(a) == pytest.approx(float(np.linalg.norm(a.astype(np.float64))), rel=1e-6)
