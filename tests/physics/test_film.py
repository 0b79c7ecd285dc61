"""Film coefficients against printed tables, hand-worked numbers, limits and each other."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydantic import ValidationError

from observer.config.laws import Surface
from observer.model.rod.screw import surface_film_W_m2K, turning_film
from observer.physics import film
from observer.physics.film import YU_AIR, air_at

KUZNETSOV_TABLE_1 = {
    2: (0.5, 0.75, 1.0, 1.25, 1.50, 1.75, 2.0, 2.25, 2.50, 2.75, 3.0),
    4: (0.25, 0.38, 0.5, 0.63, 0.75, 0.88, 1.0, 1.13, 1.25, 1.36, 1.5),
    6: (0.17, 0.25, 0.33, 0.42, 0.50, 0.58, 0.67, 0.75, 0.83, 0.92, 1.0),
    8: (0.13, 0.19, 0.25, 0.31, 0.38, 0.44, 0.50, 0.56, 0.63, 0.69, 0.75),
    10: (0.10, 0.15, 0.20, 0.25, 0.30, 0.35, 0.40, 0.45, 0.50, 0.55, 0.6),
    12: (0.08, 0.14, 0.17, 0.21, 0.25, 0.29, 0.33, 0.38, 0.42, 0.46, 0.5),
    14: (0.07, 0.11, 0.14, 0.18, 0.21, 0.25, 0.29, 0.32, 0.36, 0.39, 0.43),
    16: (0.06, 0.09, 0.13, 0.16, 0.19, 0.22, 0.25, 0.28, 0.31, 0.34, 0.38),
    18: (0.06, 0.08, 0.11, 0.14, 0.17, 0.19, 0.22, 0.25, 0.28, 0.31, 0.33),
    20: (0.05, 0.07, 0.10, 0.13, 0.15, 0.18, 0.20, 0.23, 0.25, 0.28, 0.30),
}
"""Sizes in m by film, W/m²K, for conductivities of 10, 15, … 60 W/mK."""


def test_kuznetsovs_table_is_that_of_a_biot_number_of_a_tenth_but_for_two_misprints() -> None:
    off = [
        (film_W_m2K, k_W_mK)
        for film_W_m2K, sizes_m in KUZNETSOV_TABLE_1.items()
        for k_W_mK, size_m in zip(range(10, 65, 5), sizes_m, strict=True)
        # the size is printed to a centimetre
        if abs(size_m - film.BIOT_LIMIT / film.biot(film_W_m2K, 1.0, k_W_mK)) > 0.0051
    ]
    assert off == [(4, 55), (12, 15)]


@pytest.mark.parametrize(
    ("T_K", "mu_uPa_s", "k_mW_mK", "cp_J_kgK"),
    # dry air at one atmosphere, as in standard tables, to three digits
    [(250.0, 16.06, 22.4, 1005.8), (300.0, 18.54, 26.4, 1006.4), (350.0, 20.84, 30.1, 1008.5)],
)
def test_air_is_that_of_the_tables(T_K: float, mu_uPa_s: float, k_mW_mK: float, cp_J_kgK: float) -> None:
    air = air_at(T_K - 273.15)
    density = 101_325 / (287.058 * T_K)
    assert 1e6 * air.viscosity_m2_s * density == pytest.approx(mu_uPa_s, rel=0.01)
    assert 1e3 * air.conductivity_W_mK == pytest.approx(k_mW_mK, rel=0.01)
    assert air.prandtl == pytest.approx(mu_uPa_s * cp_J_kgK / k_mW_mK * 1e-3, rel=0.01)
    assert air.expansion_1_K == pytest.approx(1 / T_K)


def test_the_air_that_yu_prints_is_air_at_25_degrees() -> None:
    air = air_at(25.0)
    assert air.viscosity_m2_s == pytest.approx(YU_AIR.viscosity_m2_s, rel=0.01)
    # the print's 2.54e-2 W/(m K) belongs to 18 °C, and its Prandtl number is rounded up
    assert air.conductivity_W_mK == pytest.approx(YU_AIR.conductivity_W_mK, rel=0.03)
    assert air.prandtl == pytest.approx(YU_AIR.prandtl, rel=0.02)


def test_a_turning_screw_by_hand() -> None:
    """Yu's screw of 16 mm at 216 rpm: Re = 22.62 · 2.56e-4/15.5e-6 = 373.6, Nu = 0.133 · 51.87 · 0.8963."""
    speed = np.array([216.0, -216.0, 0.0])
    reynolds = film.rotating_reynolds(speed, 0.016, YU_AIR)
    assert reynolds[0] == pytest.approx(373.6, rel=1e-3)
    nusselt = film.rotating_nusselt(reynolds, YU_AIR.prandtl)
    np.testing.assert_allclose(nusselt, [6.183, 6.183, 0.0], rtol=1e-3)
    assert film.film_W_m2K(nusselt, 0.016, YU_AIR)[0] == pytest.approx(9.816, rel=1e-3)
    kendoush = film.rotating_nusselt_kendoush(reynolds, YU_AIR.prandtl)
    assert kendoush[0] == pytest.approx(0.6366 * math.sqrt(373.6 * 0.72), rel=1e-3)


def test_a_horizontal_pipe_by_hand() -> None:
    """A pipe of 0.1 m in air with Ra = 5.073e6 and Pr = 0.697: (0.60 + 0.387 · 13.11/1.2063)² = 23.1."""
    assert film.horizontal_cylinder_nusselt(5.073e6, 0.697) == pytest.approx(23.1, rel=2e-3)
    assert film.horizontal_cylinder_nusselt(0.0, 0.697) == pytest.approx(0.36)


def test_the_rayleigh_number_by_hand() -> None:
    # 9.80665 · 10/273 · 1e-3 · 0.72/(15.5e-6)², as Yu's Gr Pr with Δt = 10 K and l = 0.1 m
    assert film.rayleigh(0.1, 10.0, YU_AIR) == pytest.approx(1.0766e6, rel=1e-3)


@pytest.mark.parametrize(
    ("facing", "number", "C", "n"),
    [
        ("vertical", 1e6, 0.59, 0.25), ("vertical", 1e10, 0.12, 1 / 3), ("up", 1e6, 0.54, 0.25),
        ("up", 1e8, 0.14, 1 / 3), ("down", 1e6, 0.27, 0.25), ("down", 1e9, 0.27, 0.25),
    ],
)  # fmt: skip
def test_walls_follow_the_table(facing: str, number: float, C: float, n: float) -> None:
    assert film.wall_nusselt(facing, number) == pytest.approx(C * number**n)


def test_the_gap_conducts_until_vortices_begin_and_the_ranges_meet() -> None:
    edges = film.taylor_nusselt(np.array([0.0, 1699.0, 1700.0, 9999.0, 10001.0]))
    assert edges[0] == edges[1] == 2.0
    np.testing.assert_allclose(edges[2:4], [edges[1], edges[4]], rtol=0.02)


def test_a_narrow_gap_turns_unstable_where_taylor_found_it() -> None:
    """Ta² = 1697 (Taylor 1923) in a gap that is narrow against the shaft; the geometry's factor is then 1."""
    air, radius_m, gap_m = air_at(20.0), 0.05, 1e-6
    omega = math.sqrt(1697.0 * air.viscosity_m2_s**2 / (radius_m * gap_m**3))
    number = film.taylor_number(np.array([omega * 30 / math.pi]), radius_m, gap_m, air)
    assert number[0] == pytest.approx(1697.0, rel=5e-3)


@given(cold=st.floats(-20, 60), rise=st.floats(0.01, 200), emissivity=st.floats(0.05, 1))
def test_linearised_radiation_loses_what_exact_radiation_loses(
    cold: float, rise: float, emissivity: float
) -> None:
    exact = emissivity * 5.670374419e-8 * ((cold + rise + 273.15) ** 4 - (cold + 273.15) ** 4)
    assert film.radiation_film_W_m2K(emissivity, cold, rise) * rise == pytest.approx(exact, rel=1e-6)


def test_a_thread_has_the_surface_of_its_profile_along_the_helix() -> None:
    lead, diameter, ball, land = 0.010, 0.032, 0.0032, 0.0018
    turns = np.linspace(0.0, 1.0, 20_001)
    helix = np.column_stack(
        [diameter / 2 * np.cos(2 * np.pi * turns), diameter / 2 * np.sin(2 * np.pi * turns), lead * turns]
    )
    along_m = np.linalg.norm(np.diff(helix, axis=0), axis=1).sum()
    profile_m = math.pi * ball + land
    cylinder_m2 = math.pi * diameter * lead
    factor = film.thread_factor(lead, diameter, ball, land)
    assert factor == pytest.approx(along_m * profile_m / cylinder_m2, rel=1e-7)
    assert film.thread_factor(lead, diameter, ball, land, 0.9) == pytest.approx(1 + 0.9 * factor)


@given(end=st.floats(1.0, 50.0), h=st.floats(2.0, 50.0), length=st.floats(0.2, 2.0))
def test_the_corrected_length_loses_what_a_film_on_the_face_loses(
    end: float, h: float, length: float
) -> None:
    """Kuznetsov 2021, eq. 3: L + (h_end/h) (F/P), F/P = d/4. The model takes a convective end exactly."""
    d, k = 0.03, 50.0
    m = math.sqrt(4 * h / (k * d))
    biot = end / (k * m)
    exact = (math.tanh(m * length) + biot) / (1 + biot * math.tanh(m * length))
    corrected = math.tanh(m * (length + end / h * d / 4))
    # what is neglected is of second order in m times the added length, here up to 0.3
    added = m * end / h * d / 4
    assert corrected == pytest.approx(exact, abs=max(1e-12, added**2))


def surface(**keys: object) -> Surface:
    return Surface.model_validate(keys)


def test_a_number_is_the_film_and_turning_adds_nothing_to_it() -> None:
    assert surface_film_W_m2K(surface(convection_W_m2K=15.0), 0.03) == 15.0
    assert turning_film(surface(convection_W_m2K=15.0), 0.03) is None


def test_the_base_film_is_convection_times_factors_plus_radiation() -> None:
    d, air = 0.036, air_at(25.0 + 4.0)
    still = film.horizontal_cylinder_nusselt(film.rayleigh(d, 8.0, air), air.prandtl)
    still *= air.conductivity_W_mK / d
    wanted = 3.0 * still * film.thread_factor(0.01, d, 0.003, 0.002)
    wanted += film.radiation_film_W_m2K(0.2, 25.0, 8.0)
    thread = {"thread_lead_m": 0.01, "ball_radius_m": 0.003, "land_m": 0.002}
    stated = {"factor": 3.0, "rise_K": 8.0, "air_degC": 25.0, "emissivity": 0.2}
    for law in ("churchill-chu", "rotating-cylinder", "kendoush"):
        made = surface(law=law, **stated, **thread)
        assert surface_film_W_m2K(made, d) == pytest.approx(wanted)
        turning = turning_film(made, d)
        if law == "churchill-chu":
            assert turning is None
        else:
            assert turning is not None
            assert turning(np.zeros(1))[0] == 0.0
            at_speed = surface(law=law, speed_rpm=1500.0, **stated, **thread)
            assert surface_film_W_m2K(at_speed, d) == pytest.approx(wanted + turning(np.array([1500.0]))[0])


def test_a_tube_around_the_screw_conducts_at_rest_and_stirs_when_turning() -> None:
    made = surface(law="taylor-gap", gap_m=0.008, rise_K=10.0)
    air = air_at(25.0)
    assert surface_film_W_m2K(made, 0.032) == pytest.approx(air.conductivity_W_mK / 0.008)
    turning = turning_film(made, 0.032)
    assert turning is not None
    slow, fast, faster = turning(np.array([5.0, 1000.0, 3000.0]))
    assert slow == 0.0
    assert 0.0 < fast < faster


def test_a_vertical_screw_is_a_wall_of_its_height() -> None:
    made = surface(law="wall", facing="vertical", height_m=0.5)
    air = air_at(25.0)
    nusselt = 0.59 * film.rayleigh(0.5, 10.0, air) ** 0.25
    assert surface_film_W_m2K(made, 0.03) == pytest.approx(nusselt * air.conductivity_W_mK / 0.5)


@pytest.mark.parametrize(
    ("keys", "sentence"),
    [
        ({"law": "churchill-chu", "convection_W_m2K": 5.0}, "both give the film; remove one"),
        ({"factor": 3.0}, "factor belongs to a law; give law, or remove it"),
        ({"law": "wall"}, 'facing belongs to law = "wall", and is needed there'),
        ({"law": "churchill-chu", "gap_m": 0.01}, 'gap_m belongs to law = "taylor-gap"'),
        ({"law": "churchill-chu", "speed_rpm": 500.0}, "speed_rpm has no part in law"),
        ({"law": "wall", "facing": "up", "height_m": 0.1, "speed_channel": "n"}, "speed_channel has no part"),
        ({"law": "kendoush", "speed_rpm": 500.0, "speed_channel": "n"}, "both give the speed"),
        ({"law": "churchill-chu", "thread_lead_m": 0.01}, "ball_radius_m is missing"),
        ({"law": "churchill-chu", "fin_efficiency": 0.9}, "thread_lead_m is missing"),
        ({"law": "lumped"}, "Input should be"),
    ],
)
def test_a_surface_that_contradicts_itself_is_rejected(keys: dict[str, object], sentence: str) -> None:
    with pytest.raises(ValidationError, match=sentence):
        surface(**keys)
