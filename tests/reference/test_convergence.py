"""How fast the model converges, in modes and against meshes; what the static correction costs and buys."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest

from observer.model.build import build_plant
from tests.reference.cases import config_of, known, play, point
from tests.truth import closed_forms as exact
from tests.truth.bar import Bar, End, FloatArray, Mesh
from tests.truth.rod import Heat, simulate

BAR = Bar()
HELD = (End("prescribed"), End("prescribed"))
GRID_M = np.linspace(0.0, 1.0, 501)
SOURCE_M = 1.0 / math.pi  # never near a node
COUNTS = (6, 12, 24, 48, 96)


def rate_of(errors: list[float], counts: tuple[int, ...] = COUNTS) -> float:
    """Exponent p of error ∝ (N + 1)^p, N + 1 being the first dropped mode."""
    return float(np.polyfit(np.log(np.array(counts) + 1.0), np.log(errors), 1)[0])


def field_after(
    modes: int, time_s: FloatArray, heat_W: FloatArray, correction: bool, source_m: float = SOURCE_M
) -> FloatArray:
    """The field on the grid at the end of a run of the held rod."""
    model = {"modes": modes, "static_correction": correction}
    plant = build_plant(config_of(BAR, [point("heater", source_m)], GRID_M, ends=HELD, model=model))
    z = known(plant, len(time_s), ambient=0.0, left=0.0, right=0.0, reference=0.0)
    return play(plant, time_s, heat_W[:, None], z, 0.0)[-1, plant.rows.field_slice]


def rms(difference: FloatArray) -> float:
    return float(np.sqrt(np.mean(difference**2)))


def test_with_correction_a_rising_heat_converges_two_orders_faster() -> None:
    """What is left under a ramp is the dropped modes' delay beside the lag's, b_n/Λ_n (1/Λ_{N+1} − 1/Λ_n)."""
    rate_W_s, end_s = 1e-3, 2000.0
    time_s = np.linspace(0.0, end_s, 8001)
    heat_W = rate_W_s * 0.5 * (time_s[1:] + time_s[:-1])
    truth = exact.prescribed_rod_ramp(BAR, SOURCE_M, rate_W_s, GRID_M, end_s)
    counts = COUNTS[:4]
    errors = [rms(field_after(n, time_s, heat_W, True) - truth) for n in counts]
    expected = [rate_W_s * _ramp_remainder(n) for n in counts]
    # a grid of 500 stands in for the integral: 1 % at the kink with 48 modes, which grows as N³
    assert errors == pytest.approx(expected, rel=0.02)
    assert rate_of(errors[1:], counts[1:]) == pytest.approx(-3.5, abs=0.1)


def _ramp_remainder(modes: int) -> float:
    """Root mean square over the rod of Σ_{n>N} θ_n b_n/Λ_n (1/Λ_{N+1} − 1/Λ_n), by Parseval."""
    n = np.arange(modes + 1, 4000)
    decay = BAR.diffusivity_m2_s * (n * math.pi) ** 2 + BAR.film_W_mK / BAR.capacity_J_mK
    share = math.sqrt(2.0) * np.sin(n * math.pi * SOURCE_M) / BAR.capacity_J_mK / decay
    return float(np.sqrt(np.sum((share * (1.0 / decay[0] - 1.0 / decay)) ** 2)))


def test_a_step_is_exact_once_the_first_dropped_mode_has_settled() -> None:
    """With correction only e^{−Λ_{N+1} t} of a dropped mode is missing: spectral convergence in N."""
    end_s = 120.0
    truth = exact.prescribed_rod(BAR, SOURCE_M, 10.0, GRID_M, end_s)
    errors = {
        n: rms(field_after(n, np.array([0.0, end_s]), np.array([10.0]), True) - truth) for n in (8, 16, 32)
    }
    plain = rms(field_after(32, np.array([0.0, end_s]), np.array([10.0]), False) - truth)
    for n, error in errors.items():
        unsettled = math.exp(-BAR.diffusivity_m2_s * ((n + 1) * math.pi) ** 2 * end_s)
        uncorrected = rms(field_after(n, np.array([0.0, end_s]), np.array([10.0]), False) - truth)
        assert error <= 1.05 * unsettled * uncorrected + 1e-10
    assert errors[32] < 1e-3 * plain


@pytest.mark.parametrize("correction", [True, False])
def test_meshes_close_on_the_modes_at_second_order(correction: bool) -> None:
    """Finite volumes of 20, 60, 180 cells against 150 modes: thirds keep the cell centres where they are."""
    places = Mesh(1.0, 20).centres_m[[1, 5, 12, 18]]
    ends = (End(), End("convective", 60.0))
    model = {"modes": 150, "static_correction": correction}
    config = config_of(BAR, [point("left", 0.0), point("right", 1.0)], places, ends=ends, model=model)
    plant = build_plant(config)
    time_s = np.array([0.0, 2400.0])
    z = known(plant, 2, ambient=20.0, reference=20.0)
    rows = play(plant, time_s, np.array([[9.0, 6.0]]), z, 20.0)[-1, plant.rows.field_slice]
    errors = [float(np.abs(_mesh_run(cells, places, ends) - rows).max()) for cells in (20, 60, 180)]
    rates = [math.log(a / b, 3) for a, b in itertools.pairwise(errors)]
    if correction:
        assert rates == pytest.approx([2.0, 2.0], abs=0.1)
    else:  # the modes' own truncation, not the mesh, is what the finest mesh sees
        assert rates[-1] < 1.5


def _mesh_run(cells: int, places: FloatArray, ends: tuple[End, End]) -> FloatArray:
    mesh, count = Mesh(1.0, cells), 4 * cells
    time_s = np.linspace(0.0, 2400.0, count + 1)
    heats = [
        Heat(np.eye(cells)[0], np.full(count, 9.0), "left"),
        Heat(np.eye(cells)[-1], np.full(count, 6.0), "right"),
    ]
    return simulate(BAR, mesh, time_s, heats, places, ends=ends).temperature_degC[-1, :, 0]


@pytest.mark.parametrize("modes", [8, 20, 40, 100])
def test_the_correction_never_costs_more_than_it_repays(modes: int) -> None:
    """Right after a step of heat: the dropped modes come in with one lag, not at once.

    An instant correction would be wrong at once by all that the dropped modes have not yet done; the lag is
    no worse than leaving them out, and ten seconds later far better wherever they have had time to settle.
    """
    whole, bar = 400, Bar(convection_W_m2K=0.0)
    where = np.linspace(0.0, 1.0, 201)
    step = {"static_correction": True}
    worst = {}
    for time_s in (0.5, 10.0, 60.0):
        truth = exact.insulated_rod(bar, 10.0, where, time_s, terms=whole * 10)
        for name, table in (("lag", step), ("none", {"static_correction": False})):
            config = config_of(bar, [point("heater", 0.0)], where, model={"modes": modes, **table})
            plant = build_plant(config)
            z = known(plant, 2, ambient=0.0, reference=0.0)
            rows = play(plant, np.array([0.0, time_s]), np.array([[10.0]]), z, 0.0)[
                -1, plant.rows.field_slice
            ]
            worst[name, time_s] = float(np.abs(rows - truth).max())
    slowest_dropped_1_s = bar.diffusivity_m2_s * (modes * math.pi) ** 2
    assert worst["lag", 0.5] <= 1.02 * worst["none", 0.5]
    assert worst["lag", 10.0] <= worst["none", 10.0]
    assert worst["lag", 60.0] <= 2.0 * math.exp(-60.0 * slowest_dropped_1_s) * worst["none", 60.0] + 1e-6
