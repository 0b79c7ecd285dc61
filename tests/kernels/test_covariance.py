"""What is worked out by whole registers is what numpy makes of the whole matrices."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from observer.kernels import covariance, vector
from observer.kernels.layout import aligned_zeros, pad_rows, padded_width

SIZES = [(3, 2, 1), (5, 4, 2), (9, 6, 3), (14, 11, 4), (17, 9, 7)]
"""States, those of the plant, sensors."""


def made(n: int, seed: int = 1) -> tuple[np.random.Generator, np.ndarray]:
    """Numbers to draw from, and a covariance in padded rows."""
    rng = np.random.default_rng(seed)
    A = rng.standard_normal((n, n))
    return rng, pad_rows(A @ A.T + np.eye(n), padded_width(n, 8))


def lower(P: np.ndarray) -> np.ndarray:
    return np.tril(P[:, : len(P)])


@pytest.mark.parametrize(("n", "n_x", "s"), SIZES)
def test_the_upper_triangle_is_the_lower(n: int, n_x: int, s: int) -> None:
    rng, P = made(n)
    P[:, :n] = rng.standard_normal((n, n))
    kept = np.tril(P[:, :n])
    covariance.mirror(P)
    np.testing.assert_array_equal(P[:, :n], kept + np.tril(kept, -1).T)


@pytest.mark.parametrize(
    ("n", "n_x", "columns"), [(5, 4, 1), (9, 6, 3), (14, 10, 4), (17, 9, 8), (17, 11, 6)]
)
def test_a_covariance_is_predicted(n: int, n_x: int, columns: int) -> None:
    """P⁺ = Ad P Adᵀ + Q with Ad = diag d + Σ_j G_j 1_jᵀ; only the lower triangle is read."""
    rng, P = made(n)
    width = P.shape[1]
    d, Q = pad_rows(rng.random((2, n)), width), pad_rows(np.array([np.eye(n), made(n, 2)[1][:, :n]]), width)
    G, H = aligned_zeros((columns, width)), aligned_zeros((columns, width))
    G[:columns, :n_x] = rng.standard_normal((columns, n_x))
    Ad = np.diag(d[1, :n])
    Ad[:, n_x : n_x + columns] += G[:columns, :n].T
    expected = Ad @ P[:, :n] @ Ad.T + Q[1, :, :n]
    P[:, :n] = lower(P)
    table, work = SimpleNamespace(decay=d, noise=Q), SimpleNamespace(H=H, half=np.zeros(width))
    covariance.force_columns(P, G, columns, n_x, table, 1, work)
    covariance.fade_and_force(P, H, G, columns, n_x, table, 1)
    np.testing.assert_allclose(lower(P), np.tril(expected), rtol=0, atol=1e-12 * np.abs(expected).max())


@pytest.mark.parametrize(("n", "n_x", "s"), SIZES)
def test_innovations_have_their_covariances(n: int, n_x: int, s: int) -> None:
    rng, P = made(n)
    C, x, y = rng.standard_normal((s, n_x)), rng.standard_normal(n), rng.standard_normal(s)
    wide = padded_width(s, 4)
    CT, g, S, read = (
        pad_rows(C.T, wide),
        aligned_zeros((s, P.shape[1])),
        aligned_zeros((s, wide)),
        pad_rows(y, wide),
    )
    covariance.multiply_rows(C, P, n_x, n, False, g)
    covariance.innovation_covariances(g, CT, S)
    covariance.subtract_seen(read, CT, x)
    np.testing.assert_allclose(g[:, :n], C @ P[:n_x, :n], rtol=1e-12, atol=1e-12)
    np.testing.assert_allclose(np.triu(S[:, :s]), np.triu(C @ P[:n_x, :n_x] @ C.T), rtol=1e-12, atol=1e-12)
    np.testing.assert_allclose(read[:s], y - C @ x[:n_x], rtol=1e-12, atol=1e-12)


@pytest.mark.parametrize(("n", "n_x", "s"), SIZES)
def test_a_correction_takes_squares_off(n: int, n_x: int, s: int) -> None:
    rng, P = made(n)
    L, g, W = (
        np.tril(rng.random((s, s)) + np.eye(s)),
        aligned_zeros((s, P.shape[1])),
        aligned_zeros((s, P.shape[1])),
    )
    g[:, :n] = rng.standard_normal((s, n))
    inverses = L - np.diag(np.diag(L)) + np.diag(1.0 / np.diag(L))
    for i in range(s):
        covariance.whiten(inverses, g, i, i, W)
    np.testing.assert_allclose(W, np.linalg.solve(L, g), rtol=1e-10, atol=1e-12)
    expected = P[:, :n] - W[:, :n].T @ W[:, :n]
    covariance.subtract_squares(W, s, P)
    np.testing.assert_allclose(lower(P), np.tril(expected), rtol=0, atol=1e-12 * np.abs(expected).max())


@pytest.mark.parametrize(("n", "n_x", "s"), SIZES)
def test_a_covariance_is_taken_along_by_what_couples_the_states(n: int, n_x: int, s: int) -> None:
    rng, P = made(n)
    M, T = rng.standard_normal((n_x, n_x)), np.eye(n)
    T[:n_x, :n_x] = M
    expected, width = T @ P[:, :n] @ T.T, padded_width(n_x, 8)
    covariance.take_along(pad_rows(M, width), pad_rows(M.T, width), n_x, P, np.zeros_like(P))
    np.testing.assert_allclose(lower(P), np.tril(expected), rtol=0, atol=1e-12 * np.abs(expected).max())


@pytest.mark.parametrize(("n", "n_x", "s"), SIZES)
def test_rows_have_their_variances(n: int, n_x: int, s: int) -> None:
    rng, P = made(n)
    C = rng.standard_normal((s, n_x))
    P[:, :n], expected = lower(P), np.einsum("ra,ab,rb->r", C, P[:n_x, :n_x], C)
    total = aligned_zeros((padded_width(s, 8),))
    covariance.squares_of_rows(P, pad_rows(C.T, len(total)), s, total)
    np.testing.assert_allclose(total[:s], expected, rtol=1e-12)
    covariance.squares_of_rows(P, aligned_zeros((n_x, 0)), 0, aligned_zeros((0,)))  # nothing is reported


def test_a_register_beyond_a_row_is_rejected() -> None:
    for row in (0, 1):
        with pytest.raises(IndexError, match="register 1 of a row of 6"):
            vector.load(np.zeros((2, 6)), row, 1)


def test_arrays_begin_with_a_line_of_the_cache() -> None:
    for size in range(1, 40):
        assert aligned_zeros((size, 8)).ctypes.data % 64 == 0
