"""A nut's columns are means over the nut and over the way it runs, worked out here by many points."""

from __future__ import annotations

import numpy as np
import pytest

from observer.frames import NutPath
from observer.kernels import add_columns, record
from observer.model.rod.moving import NutTable, columns, columns_at, start

SCREW_M, NUT_M, STROKE_M, CONDUCTANCE_W_M = 1.0, 0.08, 0.6, 0.05
NONE = np.zeros(0)


def table_of(*, waves: bool, turned: bool = False) -> NutTable:
    """Three modes of any phases, or three waves of a screw whose ends are alike; one lag, two rows."""
    rng = np.random.default_rng(4)
    mu = np.tile(np.arange(3) * np.pi / SCREW_M, 2) if waves else np.array([0.0, 3.7, 8.1])
    phase, scale = (NONE, NONE) if waves else (np.array([0.4, 0.9, -0.6]), np.array([1.0, 1.4, 0.7]))
    n_x = len(mu) + 1
    turn = np.eye(n_x) + 0.2 * rng.standard_normal((n_x, n_x)) if turned else np.zeros((0, 0))
    return NutTable(
        mu, phase, scale, CONDUCTANCE_W_M, NUT_M, SCREW_M, STROKE_M, len(mu), 0.3,
        rng.standard_normal((9, 2)), rng.standard_normal(n_x), rng.standard_normal(2), turn,
    )  # fmt: skip


def by_points(table: NutTable, places_m: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The columns of a nut that stands at each place for equal times."""
    nodes, weights = np.polynomial.legendre.leggauss(12)
    B, C = [], []
    for at_m in places_m:
        low, high = max(at_m - NUT_M / 2, 0.0), min(at_m + NUT_M / 2, SCREW_M)
        x = (low + high) / 2 + (high - low) / 2 * nodes
        if len(table.phase):
            modes = table.scale * np.cos(np.outer(x, table.mu_1_m) - table.phase) / CONDUCTANCE_W_M
        else:
            angle = np.outer(x - SCREW_M / 2, table.mu_1_m[: len(table.mu_1_m) // 2])
            modes = np.hstack([np.cos(angle), np.sin(angle)])
        B.append(weights @ modes / 2)
        C.append([np.interp(at_m, np.linspace(0.0, SCREW_M, 9), row) for row in table.table_C.T])
    return np.mean(B, axis=0), np.mean(C, axis=0)


@pytest.mark.parametrize("waves", [False, True])
@pytest.mark.parametrize("at_m", [0.0, 0.02, 0.31, 0.5, 0.99, 1.0])
def test_a_column_is_the_mean_over_the_nut_as_far_as_it_is_on_the_screw(waves: bool, at_m: float) -> None:
    table = table_of(waves=waves)
    B, C = np.ones(len(table.mean_B)), np.ones(2)
    add_columns(B, C, 0.5, at_m, record(table))
    expected_B, expected_C = by_points(table, np.array([at_m]))
    np.testing.assert_allclose(B, 1.0 + 0.5 * np.append(expected_B, 0.0), rtol=1e-10)
    np.testing.assert_allclose(C, 1.0 + 0.5 * expected_C, rtol=1e-10)


@pytest.mark.parametrize("waves", [False, True])
@pytest.mark.parametrize("turned", [False, True])
def test_over_a_step_it_is_the_mean_over_the_way_and_a_lag_s_row_follows_slowly(waves, turned) -> None:
    """A nut that runs one way; nobody knows how it came to its first sample."""
    table = table_of(waves=waves, turned=turned)
    at_s = 0.1 * np.arange(61)
    path = NutPath(at_s, 0.2 + 0.06 * at_s, np.arange(0, 62, 5), *np.full((2, 61), np.nan))
    dt_s = np.full(12, 0.5)
    _, B, C = columns(table, start(table), dt_s, path)
    settle, row = 1.0 - np.exp(-0.5 * table.lag_decay_1_s), C[2]
    for k in range(3, 12):
        way_m = 0.2 + 0.06 * np.linspace(at_s[5 * k] - 0.1, at_s[5 * k + 4], 401)
        own, seen = by_points(table, way_m)
        own = np.append(own, table.lag_decay_1_s)
        np.testing.assert_allclose(
            B[k], table.turn @ own if turned else own, rtol=0, atol=2e-3 * np.abs(own).max()
        )
        row = row + settle * (seen - row)
        np.testing.assert_allclose(C[k], row, rtol=0, atol=1e-2)


def test_a_nut_of_which_nothing_is_known_keeps_its_columns_and_then_is_spread_over_its_stroke() -> None:
    """Samples at 0 s and 1 s, nothing for half a minute, and one sample elsewhere."""
    table = table_of(waves=False)
    path = NutPath(
        np.array([0.0, 1.0, 31.0]),
        np.array([0.3, 0.3, 0.7]),
        np.array([0, 1, 2, 2, 3]),
        *np.full((2, 3), np.nan),
    )
    _, B, C = columns(table, start(table), np.array([1.0, 1.0, 15.0, 15.0]), path)
    there = columns_at(table, [0.3])[0][:-1]
    np.testing.assert_allclose(B[:2, :-1], [there, there], rtol=1e-12)
    np.testing.assert_array_equal(B[2], B[1])
    np.testing.assert_array_equal(C[2], C[1])
    np.testing.assert_array_equal(B[3, :-1], table.mean_B[:-1])
    settle = 1.0 - np.exp(-15.0 * table.lag_decay_1_s)
    np.testing.assert_allclose(C[3], C[2] + settle * (table.mean_C - C[2]), rtol=1e-12)


def test_after_an_hour_of_silence_nobody_knows_which_way_a_nut_runs() -> None:
    """It ran to and fro, so its ends are known; two samples half a minute apart say nothing of its way."""
    table, run_s = table_of(waves=False), 0.5 * np.arange(91)
    run_m = 0.2 + 0.3 * (1.0 - np.abs(1.0 - np.mod(run_s, 20.0) / 10.0)) * 2.0
    path = NutPath(
        np.append(run_s, [4045.0, 4075.0]),
        np.append(run_m, [0.3, 0.5]),
        np.array([0, 91, 92, 93]),
        *np.full((2, 93), np.nan),
    )
    _, B, _ = columns(table, start(table), np.array([45.0, 4000.0, 30.0]), path)
    np.testing.assert_array_equal(B[2, :-1], table.mean_B[:-1])
    assert (B[1, :-1] != table.mean_B[:-1]).all(), "of the hour it is taken to have run on"
