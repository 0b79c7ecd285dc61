"""The papers' closed forms against finite volumes, quadrature and their own limits."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest

from tests.truth import closed_forms, kuznetsov, yu
from tests.truth.bar import Bar, End, Mesh
from tests.truth.rod import Heat, simulate

BAR = Bar(length_m=0.6, diameter_m=0.03, convection_W_m2K=12.0)
WHERE_M = np.array([0.0, 0.05, 0.2, 0.33, 0.6])


@pytest.mark.parametrize("time_s", [60.0, 900.0, 6000.0])
def test_kuznetsovs_series_is_the_cosine_series_of_the_insulated_fin(time_s: float) -> None:
    series = kuznetsov.field(BAR, 7.0, 0.0, WHERE_M, time_s)
    cosines = closed_forms.insulated_fin(BAR, 0.0, 7.0, WHERE_M, np.array([time_s]))[0]
    np.testing.assert_allclose(series, cosines, rtol=1e-10, atol=1e-10)


def test_kuznetsovs_series_is_what_finite_volumes_find() -> None:
    mesh, count = Mesh(BAR.length_m, 300), 400
    left, right = np.eye(mesh.cells)[0], np.eye(mesh.cells)[-1]
    heats = [Heat(left, np.full(count, 6.0), end="left"), Heat(right, np.full(count, 9.0), end="right")]
    cold = {"ambient_degC": 0.0, "initial_degC": 0.0}
    run = simulate(BAR, mesh, np.linspace(0.0, 1200.0, count + 1), heats, WHERE_M, **cold)
    # (dx²/8) T'' of the mesh, T'' up to 700 K/m²
    np.testing.assert_allclose(
        run.temperature_degC[-1, :, 0], kuznetsov.field(BAR, 6.0, 9.0, WHERE_M, 1200.0), atol=2e-3
    )
    np.testing.assert_allclose(
        run.integral_Km[-1, :, 0], kuznetsov.growth(BAR, 6.0, 9.0, WHERE_M, 1200.0), atol=5e-4
    )


@pytest.mark.parametrize("time_s", [5.0, 300.0, 9000.0])
def test_the_growth_is_the_integral_of_the_field(time_s: float) -> None:
    node, weight = np.polynomial.legendre.leggauss(40)
    cuts = np.concatenate([[0.0], 0.6 * np.geomspace(1e-3, 1.0, 12)])
    total = 0.0
    for low, high in itertools.pairwise(cuts):
        x = 0.5 * (low + high) + 0.5 * (high - low) * node
        total += 0.5 * (high - low) * float(weight @ kuznetsov.field(BAR, 6.0, 9.0, x, time_s))
    grown = kuznetsov.growth(BAR, 6.0, 9.0, np.array([0.6]), time_s)[0]
    assert grown == pytest.approx(total, rel=1e-9)


def test_the_series_settles_on_the_steady_limit_with_both_signs_plus() -> None:
    grown = kuznetsov.growth(BAR, 6.0, 9.0, WHERE_M, 1e5)
    np.testing.assert_allclose(grown, kuznetsov.steady_growth(BAR, 6.0, 9.0, WHERE_M), rtol=1e-9, atol=1e-12)
    ends = (End(), End())
    rise = closed_forms.steady_fin(BAR, ends, 0.0, 6.0, WHERE_M)
    rise += closed_forms.steady_fin(BAR, ends, 0.6, 9.0, WHERE_M)
    np.testing.assert_allclose(kuznetsov.field(BAR, 6.0, 9.0, WHERE_M, 1e5), rise, rtol=1e-9)


def test_at_rest_the_whole_growth_is_all_the_heat_over_the_film() -> None:
    whole = kuznetsov.steady_growth(BAR, 6.0, 9.0, np.array([0.6]))[0]
    assert whole == pytest.approx(15.0 / BAR.film_W_mK)


def test_an_overhang_takes_the_share_of_its_admittance() -> None:
    """A support at 0.4 m of a screw whose overhang has a film on its face: the share by the steady field."""
    m, face = kuznetsov.fin_1_m(BAR), 40.0
    share = kuznetsov.share_past_a_support(m, 0.4, m, 0.2, face / BAR.conductivity_W_mK)
    h = 1e-4
    near = closed_forms.steady_fin(
        BAR, (End(), End("convective", face)), 0.4, 10.0, np.array([0.4 - 2 * h, 0.4 - h, 0.4])
    )
    slope = (3 * near[2] - 4 * near[1] + near[0]) / (2 * h)
    assert share == pytest.approx(BAR.conductance_Wm_K * slope / 10.0, rel=1e-5)


def test_yus_exponentials_are_the_fin_between_known_ends() -> None:
    ends = (End("prescribed"), End("prescribed"))
    fin = closed_forms.steady_fin(BAR, ends, 0.3, 0.0, WHERE_M, left_degC=8.0, right_degC=3.0)
    np.testing.assert_allclose(yu.steady(BAR, 8.0, 3.0, WHERE_M), fin, rtol=1e-9)


def test_yus_product_is_right_without_a_film_and_at_rest_but_not_in_between() -> None:
    where = np.linspace(0.0, 0.4, 81)
    thin = Bar(convection_W_m2K=1e-9)
    step = closed_forms.half_space_step(thin, 10.0, where, 900.0)
    np.testing.assert_allclose(yu.product(thin, 10.0, where, 900.0), step, atol=1e-4)
    np.testing.assert_allclose(yu.step_with_film(thin, 10.0, where, 900.0), step, atol=1e-4)
    late = yu.step_with_film(BAR, 10.0, where, 1e6)
    np.testing.assert_allclose(late, 10.0 * np.exp(-kuznetsov.fin_1_m(BAR) * where), rtol=1e-3)
    gap = yu.step_with_film(BAR, 10.0, where, 1800.0) - yu.product(BAR, 10.0, where, 1800.0)
    # docs/papers.md says so: half an hour after the step it misses a sixth of it
    assert gap.max() == pytest.approx(1.6, abs=0.1)


def test_the_exact_step_with_a_film_is_what_finite_volumes_find() -> None:
    long = Bar(length_m=2.0, diameter_m=0.03, convection_W_m2K=12.0)
    mesh, where = Mesh(2.0, 800), np.array([0.02, 0.1, 0.25])
    cold = {"ambient_degC": 0.0, "initial_degC": 0.0, "left_degC": 10.0}
    ends = (End("prescribed"), End())
    run = simulate(long, mesh, np.linspace(0.0, 900.0, 1801), [], where, ends=ends, **cold)
    np.testing.assert_allclose(
        run.temperature_degC[-1, :, 0], yu.step_with_film(long, 10.0, where, 900.0), atol=3e-3
    )


def test_one_harmonic_is_the_swinging_half_space() -> None:
    time_s, period_s = np.linspace(0.0, 1200.0, 50), 1200.0
    omega = 2.0 * math.pi / period_s
    swing = closed_forms.half_space_periodic(BAR, 5.0, period_s, 0.04, time_s)
    np.testing.assert_allclose(yu.periodic(BAR, [(5.0, math.pi / 2)], omega, 0.04, time_s), swing, atol=1e-12)


@pytest.mark.parametrize(("first", "second"), [(2e8, 5e7), (1e9, 3e8)])
def test_the_middle_of_kuznetsovs_14_is_his_13_with_the_whole_screw_in_the_bracket(
    first: float, second: float
) -> None:
    """At x = L, with L P/EF in the bracket where (13) prints x P/EF; of both forms of K_j only the first.

    The last member of (14) is K_j itself: the print multiplies it by the growth, which it was divided by.
    """
    own, grown_m, preload_N, gap_m = 3e8, 60e-6, 2000.0, 8e-6
    total = 1.0 / (1.0 / first + 1.0 / second + 1.0 / own)
    stretch_m = preload_N / own
    moved_m = grown_m - stretch_m - total * (1.0 / first + 1.0 / own) * (grown_m - stretch_m - gap_m)
    K_preload, K_gap, share = stretch_m / grown_m, gap_m / grown_m, total / second
    middle = share - share * K_preload + total * (1.0 / first + 1.0 / own) * K_gap
    assert moved_m / grown_m == pytest.approx(middle, rel=1e-12)
    assert share * (1.0 - K_preload - K_gap) + K_gap == pytest.approx(middle, rel=1e-12)
    assert share * (1.0 - K_preload) + K_gap * (1.0 - K_preload) != pytest.approx(middle, rel=1e-2)
