"""At rest the field is exact with any number of modes: every pairing of ends, with and without film."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from observer.model.build import build_plant
from tests.reference.cases import config_of, known, play, point
from tests.truth import closed_forms as exact
from tests.truth.bar import Bar, End, Mesh, band_share
from tests.truth.rod import Heat, simulate

ENDS = {"insulated": End(), "convective": End("convective", 40.0), "prescribed": End("prescribed")}
PAIRS = list(itertools.product(ENDS, ENDS))
FEW = {"modes": 4}
GRID_M = np.array([0.0, 0.07, 0.31, 0.33, 0.62, 0.94, 1.0])
SETTLED_S = np.arange(41) * 1.0e5
SETTLING = [
    (left, right, film)
    for left, right, film in itertools.product(ENDS, ENDS, (0.0, 15.0))
    if (left, right, film) != ("insulated", "insulated", 0.0)
]


@pytest.mark.parametrize(("left", "right", "film_W_m2K"), SETTLING)
@pytest.mark.parametrize("source_m", [0.0, 0.32, 1.0])
def test_modes_and_correction_settle_on_the_steady_fin(
    left: str, right: str, film_W_m2K: float, source_m: float
) -> None:
    bar, ends = Bar(convection_W_m2K=film_W_m2K), (ENDS[left], ENDS[right])
    plant = build_plant(config_of(bar, [point("heater", source_m)], GRID_M, ends=ends, model=FEW))
    held = {"ambient_degC": 22.0, "left_degC": 25.0, "right_degC": 19.0}
    z = known(plant, len(SETTLED_S), ambient=22.0, left=25.0, right=19.0, reference=20.0)
    rows = play(plant, SETTLED_S, np.full((len(SETTLED_S) - 1, 1), 8.0), z, 22.0)[-1]

    steady = exact.steady_fin(bar, ends, source_m, 8.0, GRID_M, **held)
    # exact but for rounding: the slowest rod (film 0, one convective end) has settled to e^-40
    np.testing.assert_allclose(rows[plant.rows.field_slice], steady, atol=1e-8)

    growth_um = [1e6 * bar.expansion_1_K * _excess(bar, ends, source_m, x, held) for x in GRID_M]
    np.testing.assert_allclose(rows[plant.rows.error_slice], growth_um, atol=1e-7)


def _excess(bar: Bar, ends: tuple[End, End], source_m: float, to_m: float, held: dict[str, float]) -> float:
    """∫_0^x (T − 20) dx of the steady fin, by Gauss–Legendre between the kinks."""
    node, weight = np.polynomial.legendre.leggauss(20)
    cuts = np.unique([0.0, min(source_m, to_m), to_m])
    total = 0.0
    for low, high in itertools.pairwise(cuts):
        x = 0.5 * (low + high) + 0.5 * (high - low) * node
        rise = exact.steady_fin(bar, ends, source_m, 8.0, x, **held) - 20.0
        total += 0.5 * (high - low) * float(weight @ rise)
    return total


def test_an_isolated_rod_keeps_all_its_heat_and_the_right_profile() -> None:
    bar = Bar(convection_W_m2K=0.0)
    plant = build_plant(config_of(bar, [point("heater", 0.0)], GRID_M, model=FEW))
    time_s = np.linspace(0.0, 2.0e5, 11)  # L²/(π² α) = 7270 s: the profile is quasi-steady to e^-27
    z = known(plant, len(time_s), ambient=22.0, reference=20.0)
    rows = play(plant, time_s, np.full((10, 1), 3.0), z, 20.0)[-1]
    truth = 20.0 + exact.insulated_rod(bar, 3.0, GRID_M, 2.0e5)
    np.testing.assert_allclose(rows[plant.rows.field_slice], truth, atol=1e-7)


@pytest.mark.parametrize(("left", "right"), PAIRS)
def test_a_band_settles_on_the_mean_of_its_points(left: str, right: str) -> None:
    bar, ends = Bar(), (ENDS[left], ENDS[right])
    band = {"name": "heater", "shape": "band", "from_m": 0.3, "to_m": 0.45, "power_channel": "heater_W"}
    plant = build_plant(config_of(bar, [band], GRID_M, ends=ends, model=FEW))
    z = known(plant, len(SETTLED_S), ambient=0.0, left=0.0, right=0.0, reference=20.0)
    rows = play(plant, SETTLED_S, np.full((len(SETTLED_S) - 1, 1), 8.0), z, 0.0)[-1]
    truth = exact.steady_fin_band(bar, ends, 0.3, 0.45, 8.0, GRID_M)
    np.testing.assert_allclose(rows[plant.rows.field_slice], truth, atol=1e-8)


@pytest.mark.parametrize("film_W_m2K", [0.0, 15.0])
@pytest.mark.parametrize(("left", "right"), PAIRS)
def test_every_pairing_follows_the_finite_volumes_through_a_transient(
    left: str, right: str, film_W_m2K: float
) -> None:
    bar, ends, mesh = Bar(convection_W_m2K=film_W_m2K), (ENDS[left], ENDS[right]), Mesh(1.0, 400)
    time_s = np.arange(0.0, 3601.0, 4.0)
    swing = np.sin(2.0 * np.pi * time_s / 1800.0)
    outside = {"ambient": 20.0 + swing, "left": 20.0 + 4.0 * swing, "right": 20.0 - 3.0 * swing}
    heat_W = np.column_stack([6.0 + 3.0 * swing[1:], 5.0 - 2.0 * swing[1:], 9.0 + 0.0 * swing[1:]])
    bearing, far = point("bearing", 0.0), point("far", 1.0)
    band = {"name": "heater", "shape": "band", "from_m": 0.3, "to_m": 0.45, "power_channel": "heater_W"}
    plant = build_plant(config_of(bar, [bearing, far, band], GRID_M, ends=ends, model={"modes": 60}))
    rows = play(plant, time_s, heat_W, known(plant, len(time_s), **outside, reference=20.0), 20.0)

    left_share, right_share = np.eye(mesh.cells)[0], np.eye(mesh.cells)[-1]
    heats = [
        Heat(left_share, heat_W[:, 0], end="left"),
        Heat(right_share, heat_W[:, 1], end="right"),
        Heat(band_share(mesh, 0.3, 0.45), heat_W[:, 2]),
    ]
    truth = simulate(
        bar, mesh, time_s, heats, GRID_M, ends=ends,
        ambient_degC=outside["ambient"], left_degC=outside["left"], right_degC=outside["right"],
    )  # fmt: skip
    # what the dropped modes' one lag does right after the first jump is for test_transient.py
    late = time_s >= 60.0
    # the mesh's own (dx²/8) T'' with T'' up to 1500 K/m² is 1 mK; the rest is the time step's share
    np.testing.assert_allclose(
        rows[late, plant.rows.field_slice], truth.temperature_degC[late, :, 0], atol=5e-3
    )
    error_um = truth.error_um(bar, 20.0)[late, :, 0]
    np.testing.assert_allclose(rows[late, plant.rows.error_slice], error_um, atol=1e-2)
