"""Truth against truth: the finite volumes and the closed forms, each other's witness."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest

from tests.truth import closed_forms as exact
from tests.truth.bar import Bar, End, Mesh, band_share, nut_share, point_share, shuttle_m, substep_times
from tests.truth.rod import Heat, simulate

ENDS = {"insulated": End(), "convective": End("convective", 40.0), "prescribed": End("prescribed")}
# without film and with both ends insulated there is no steady state
SETTLING = [
    (left, right, film)
    for left, right, film in itertools.product(ENDS, ENDS, (0.0, 15.0))
    if (left, right, film) != ("insulated", "insulated", 0.0)
]
WHERE_M = np.array([0.0, 0.11, 0.37, 0.62, 0.9, 1.0])
PLAIN = Bar(convection_W_m2K=0.0)


def steps(end_s: float, count: int) -> np.ndarray:
    return np.linspace(0.0, end_s, count + 1)


@pytest.mark.parametrize(("left", "right", "film_W_m2K"), SETTLING)
def test_the_finite_volumes_settle_on_the_steady_fin(left: str, right: str, film_W_m2K: float) -> None:
    ends = (ENDS[left], ENDS[right])
    bar, mesh = Bar(convection_W_m2K=film_W_m2K), Mesh(1.0, 400)
    heat = Heat(point_share(mesh, 0.30125), np.full(60, 8.0))
    held = {"ambient_degC": 22.0, "left_degC": 25.0, "right_degC": 19.0}
    run = simulate(bar, mesh, np.arange(61) * 1.0e5, [heat], WHERE_M, ends=ends, **held)
    steady = exact.steady_fin(bar, ends, 0.30125, 8.0, WHERE_M, **held)
    # truncation of the 2nd-order mesh: (dx²/8) T'' with T'' = m² ΔT ≈ 30 · 50 1/m² gives 1e-3 K
    np.testing.assert_allclose(run.temperature_degC[-1, :, 0], steady, atol=3e-3)


def test_the_rod_converges_at_second_order_on_the_fourier_series() -> None:
    def worst(cells: int) -> float:
        mesh, count = Mesh(1.0, cells), 4 * cells
        ends = (ENDS["prescribed"], ENDS["prescribed"])
        heat = Heat(point_share(mesh, source_m), np.full(count, 10.0))
        run = simulate(Bar(), mesh, steps(2000.0, count), [heat], where, ends=ends)
        return float(np.max(np.abs(run.temperature_degC[-1, :, 0] - 20.0 - truth)))

    # thirds of a cell: a centre of the coarse mesh is one of each finer mesh
    source_m, where = Mesh(1.0, 20).centres_m[6], Mesh(1.0, 20).centres_m[[2, 9, 15]]
    truth = exact.prescribed_rod(Bar(), source_m, 10.0, where, 2000.0)
    errors = [worst(cells) for cells in (20, 60, 180)]
    rates = [math.log(a / b, 3) for a, b in itertools.pairwise(errors)]
    # second order in space and time; the coarse mesh is not yet quite asymptotic
    assert rates == pytest.approx([2.0, 2.0], abs=0.1)


def test_a_heat_through_the_end_is_the_insulated_rods_series() -> None:
    mesh = Mesh(1.0, 400)
    heat = Heat(point_share(mesh, 0.0), np.full(800, 9.0), end="left")
    run = simulate(PLAIN, mesh, steps(1200.0, 800), [heat], WHERE_M)
    truth = exact.insulated_rod(PLAIN, 9.0, WHERE_M, 1200.0)
    # (dx²/8) T'' near the heated face, T'' = (dT/dt)/α ≈ 700 K/m²
    np.testing.assert_allclose(run.temperature_degC[-1, :, 0] - 20.0, truth, atol=2e-3)


def test_the_insulated_rod_is_a_half_space_while_the_far_end_is_cold() -> None:
    where = np.array([0.0, 0.02, 0.08])
    early = exact.insulated_rod(PLAIN, 9.0, where, 100.0)
    np.testing.assert_allclose(early, exact.half_space_flux(PLAIN, 9.0, where, 100.0), rtol=1e-6, atol=1e-6)


def test_a_face_that_jumps_and_one_that_swings_follow_the_half_space() -> None:
    mesh, ends = Mesh(1.0, 500), (ENDS["prescribed"], ENDS["insulated"])
    time_s = steps(600.0, 1200)
    jump = simulate(PLAIN, mesh, time_s, [], np.array([0.05]), ends=ends, left_degC=30.0)
    assert jump.temperature_degC[-1, 0, 0] == pytest.approx(
        20.0 + exact.half_space_step(PLAIN, 10.0, np.array([0.05]), 600.0)[0], abs=2e-3
    )
    time_s = steps(7200.0, 7200)
    face = 20.0 + 5.0 * np.sin(2.0 * math.pi * time_s / 1200.0)
    swing = simulate(PLAIN, mesh, time_s, [], np.array([0.04]), ends=ends, left_degC=face)
    last = time_s > 6000.0
    truth = 20.0 + exact.half_space_periodic(PLAIN, 5.0, 1200.0, 0.04, time_s[last])
    # the start-up transient of the sine fades as t^(-3/2): below 0.02 K in the sixth period
    np.testing.assert_allclose(swing.temperature_degC[last, 0, 0], truth, atol=0.02)


def test_a_slab_cools_through_a_convective_end() -> None:
    mesh = Mesh(1.0, 400)
    ends = (End(), End("convective", 80.0))
    run = simulate(PLAIN, mesh, steps(20000.0, 1000), [], WHERE_M, ends=ends, initial_degC=50.0)
    truth = 20.0 + exact.cooling_slab(PLAIN, 80.0, 30.0, WHERE_M, 20000.0)
    np.testing.assert_allclose(run.temperature_degC[-1, :, 0], truth, atol=1e-3)


def test_no_heat_is_lost_or_made_by_a_moving_nut() -> None:
    mesh, time_s = Mesh(1.0, 160), steps(300.0, 300)
    share = nut_share(mesh, 0.08, shuttle_m(substep_times(time_s, 8), 0.2, 0.7, 0.4))
    np.testing.assert_allclose(share.sum(axis=1), 1.0, rtol=1e-12)
    heats = [Heat(share, np.full(300, 30.0)), Heat(band_share(mesh, 0.1, 0.1517), np.full(300, 5.0))]
    run = simulate(PLAIN, mesh, time_s, heats, np.array([0.0, 1.0]))
    stored = PLAIN.capacity_J_mK * (run.integral_Km[-1, 1, 0] - run.integral_Km[0, 1, 0])
    assert stored == pytest.approx(35.0 * 300.0, rel=1e-10)


def test_a_band_is_the_mean_of_its_points() -> None:
    bar, mesh, ends = Bar(), Mesh(1.0, 500), (End(), End("convective", 30.0))
    heat = Heat(band_share(mesh, 0.4, 0.6), np.full(60, 10.0))
    where = np.array([0.2, 0.5, 0.55, 0.95])
    far_s = np.arange(61) * 2.0e4
    run = simulate(bar, mesh, far_s, [heat], where, ends=ends, ambient_degC=0.0, initial_degC=0.0)
    truth = exact.steady_fin_band(bar, ends, 0.4, 0.6, 10.0, where)
    np.testing.assert_allclose(run.temperature_degC[-1, :, 0], truth, atol=1e-3)


def test_the_insulated_fin_is_the_insulated_rod_while_the_film_has_done_nothing() -> None:
    thin = Bar(convection_W_m2K=1e-6)
    series = exact.insulated_fin(thin, 0.0, 9.0, WHERE_M, np.array([30.0, 900.0]))
    # without film the mean is a difference of two steady rises of 1e8 K: what is left of 16 digits
    for row, time_s in zip(series, (30.0, 900.0), strict=True):
        np.testing.assert_allclose(row, exact.insulated_rod(PLAIN, 9.0, WHERE_M, time_s), atol=1e-5)
